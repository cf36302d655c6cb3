# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Bags of before messages grew: samples and events are read, features are not."""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import get_types_from_msg, get_typestore, Stores

from tactile_bags import EVENT, FEATURES, STRAIN, TactileBag
from tactile_bags.errors import BagError
from tactile_bags.replaying.replay import recorded_results
from tactile_lab.datasets.bag_tables import read_tables

ADDED = ('string specification_digest', 'float64 stamp_error_s', 'uint8 OUTCOME_BAD_TIME')
S = 1_000_000_000


def old_store():
    """The types as they were."""
    store = get_typestore(Stores.ROS2_JAZZY)
    for path in sorted(Path(get_package_share_directory('tactile_msgs')).glob('msg/*.msg')):
        lines = path.read_text().splitlines()
        if path.stem == 'TactileFeatures':
            lines = [line for line in lines if not line.startswith(ADDED)]
        if path.stem == 'TrialEvent':
            lines = [line for line in lines if not line.startswith('string mounting_id')]
        name = f'tactile_msgs/msg/{path.stem}'
        store.register(get_types_from_msg('\n'.join(lines), name))
    return store


@pytest.fixture(params=[StoragePlugin.MCAP, StoragePlugin.SQLITE3], ids=['mcap', 'sqlite'])
def old_bag(request, tmp_path):
    store = old_store()
    types = store.types

    def header(stamp_ns):
        stamp = types['builtin_interfaces/msg/Time'](stamp_ns // S, stamp_ns % S)
        return types['std_msgs/msg/Header'](stamp, 'link')

    def default(name, **fields):
        kinds = {'string': '', 'bool': False, 'float64': 0.0, 'uint8': 0, 'uint32': 0, 'uint64': 0}
        for field, (_, kind) in store.fielddefs[name][1]:
            if isinstance(kind, tuple) and isinstance(kind[0], str) and kind[0] in kinds:
                fields.setdefault(field, kinds[kind[0]])
        return types[name](**fields)

    path = tmp_path / 'old'
    with Writer(path, version=9, storage_plugin=request.param) as writer:
        topics = {
            kind: writer.add_connection(topic, kind, typestore=store)
            for topic, kind in (
                ('/tendon_sensor/strain', STRAIN),
                ('/trial_runner/events', EVENT),
                ('/tactile_features/features', FEATURES),
            )
        }

        def write(kind, at_ns, message):
            writer.write(topics[kind], at_ns, store.serialize_cdr(message, kind))

        tension_n = np.random.default_rng(0).normal(3.0, 0.1, 600)
        for i, label in enumerate(('R1', 'R2')):
            start_ns = 100 * S + i * 20 * S
            block = default(
                STRAIN,
                header=header(start_ns),
                sequence=i * 1200,
                period_ns=16_666_667,
                tension_n=tension_n,
            )
            write(STRAIN, start_ns, block)
            for time_s, phase in ((1, 'glide'), (7, 'done')):
                event = default(
                    EVENT,
                    header=header(start_ns + time_s * S),
                    trial_id=f't{i}',
                    protocol='texture',
                    contact='flexion',
                    object_label=label,
                    phase=phase,
                )
                write(EVENT, start_ns + time_s * S, event)
            features = default(
                FEATURES,
                header=header(start_ns + 6 * S),
                values=np.zeros(91),
                window_start=types['builtin_interfaces/msg/Time'](0, 0),
                window_end=types['builtin_interfaces/msg/Time'](0, 0),
                measures=[],
            )
            write(FEATURES, start_ns + 8 * S, features)
    return path


def test_old_bags_are_trained_on(old_bag):
    (table,) = read_tables([old_bag]).tables.values()
    assert table.labels.tolist() == ['R1', 'R2']
    assert table.columns['trial_id'].tolist() == ['t0', 't1']
    assert table.columns['mounting_id'].tolist() == ['', '']


def test_old_features_are_refused_with_what_is_left(old_bag):
    with TactileBag(old_bag) as bag:
        assert bag.end_ns == 128 * S
        assert len(list(bag.messages(STRAIN, EVENT))) == 6
        with pytest.raises(BagError, match=r'another definition.*TactileFeatures.*training'):
            recorded_results(bag)
