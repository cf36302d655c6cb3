# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""A recording contains the specifications of its features, and the models that were used."""

import dataclasses
import hashlib

import numpy as np
import pytest
from rclpy.serialization import serialize_message
from rosbags.typesys import get_types_from_msg, get_typestore, Stores

from tactile_analysis.datasets.feature_tables import name_table, read_tables
from tactile_bags import BagWriter, message_store, TactileBag
from tactile_bags.errors import BagError
from tactile_bags.mcap_reader import StoredTopic
from tactile_bags.message_types import qos_text
from tactile_bags.recorded_setup import (
    find_models,
    gather_models,
    nominal_rate_hz,
    recorded_features,
    recorded_models,
    RecordedFeatures,
    WRITTEN_IN,
)
from tactile_classifier import ModelInfos, ModelSet
from tactile_classifier.conversions import model_infos_to_msg
from tactile_features import FeatureConfig, FeatureSpecifications, spec_for
from tactile_features.conversions import specifications_to_msg
from tactile_ros.errors import TactileError
from tactile_ros.topics import (
    MODELS_TOPIC,
    RecordedTopic,
    SPECIFICATIONS,
    SPECIFICATIONS_TOPIC,
    STRAIN_TOPIC,
)

USUAL = spec_for('stiffness', FeatureConfig())
SETTLED = spec_for('stiffness', FeatureConfig(stiffness_settle_s=1.0))
GLIDE = spec_for('texture', FeatureConfig())


@pytest.fixture
def record(stiffness_bag, tmp_path):
    """Return a function that copies a recording of stiffness trials and adds messages."""

    def record(*further, name='bag', **metadata):
        path = tmp_path / name
        with TactileBag(stiffness_bag) as bag, BagWriter(path, metadata) as writer:
            for topic, (type_name, _) in bag.topics.items():
                writer.add_topic(RecordedTopic(topic.strip('/'), type_name))
            messages = list(bag.messages())
            names = {topic: writer.add_topic(topic) for topic in dict(further)}
            for topic, message in further:
                data = serialize_message(message)
                writer.write_raw(names[topic], messages[0].received_at_ns, data)
            for message in messages:
                writer.write_raw(message.topic, message.received_at_ns, message.data)
        return path

    return record


def announce(*wanted, **config):
    announced = FeatureSpecifications(wanted, dataclasses.asdict(FeatureConfig(**config)))
    return SPECIFICATIONS_TOPIC, specifications_to_msg(announced)


def test_recorded_features_are_those_that_the_node_announced(record):
    with TactileBag(record(announce(GLIDE, USUAL, samples_timeout_s=7.0))) as bag:
        features = recorded_features(bag)
        assert nominal_rate_hz(bag) == 60.0
    assert features == RecordedFeatures(FeatureConfig(samples_timeout_s=7.0), (GLIDE, USUAL))


def test_restart_of_the_node_adds_new_specifications(record):
    path = record(announce(GLIDE, USUAL), announce(GLIDE, SETTLED), announce(USUAL))
    with TactileBag(path) as bag:
        wanted = recorded_features(bag).wanted
    assert wanted == (GLIDE, USUAL, SETTLED)


def test_no_rate_is_compared_if_recorded_rates_differ(record):
    fast = spec_for('stiffness', FeatureConfig(rate_hz=100.0))
    with TactileBag(record(announce(USUAL, fast))) as bag:
        assert nominal_rate_hz(bag) == 0.0


def test_specifications_of_another_release_are_replaced(tmp_path):
    """A message type with an additional field stands for another release of the packages."""
    installed = message_store()
    definition, _ = installed.generate_msgdef(SPECIFICATIONS, ros_version=2)
    definition = definition.replace('string digest\n', 'string digest\nstring colour\n')
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(definition, SPECIFICATIONS))
    texts = {'names', 'units', 'parameter_names', 'parameter_values'}
    nothing = {'string': '', 'uint32': 0, 'float64': 0.0}
    entry = store.types['tactile_msgs/msg/FeatureSpecification'](
        **{
            name: nothing.get(detail[0], [] if name in texts else np.empty(0, np.uint32))
            for name, (_, detail) in store.fielddefs['tactile_msgs/msg/FeatureSpecification'][1]
        }
    )
    time = store.types['builtin_interfaces/msg/Time'](sec=0, nanosec=0)
    header = store.types['std_msgs/msg/Header'](stamp=time, frame_id='')
    config = '{"samples_timeout_s": 7.0, "colour": 1}'
    message = store.types[SPECIFICATIONS](header=header, specifications=[entry], config=config)
    topic = StoredTopic(
        '/tactile_features/specifications',
        SPECIFICATIONS,
        store.hash_rihs01(SPECIFICATIONS),
        definition,
        qos=qos_text(latched=True),
    )
    with BagWriter(tmp_path / 'bag', {}) as writer:
        writer.add_topic(STRAIN_TOPIC)
        data = bytes(store.serialize_cdr(message, SPECIFICATIONS))
        writer.write_raw(writer.add_stored_topic(topic), 1, data)
    with TactileBag(tmp_path / 'bag') as bag:
        features = recorded_features(bag)
    assert features == RecordedFeatures(FeatureConfig(samples_timeout_s=7.0))


def test_parameters_of_another_release_are_ignored(record):
    topic, message = announce(USUAL)
    message.config = '{"measures": true, "colour": 1, "samples_timeout_s": 7.0}'
    with TactileBag(record((topic, message))) as bag:
        assert recorded_features(bag).config == FeatureConfig(samples_timeout_s=7.0)


@pytest.mark.parametrize('config', ['{"rate_hz": -1.0}', '"red"', '[1]'])
def test_invalid_recorded_parameters_are_refused(record, config):
    topic, message = announce(USUAL)
    message.config = config
    with TactileBag(record((topic, message))) as bag:
        with pytest.raises(BagError, match='feature parameters'):
            recorded_features(bag)
        assert nominal_rate_hz(bag) == 0.0


def test_each_specification_of_a_phase_has_a_table(record):
    tables = read_tables([record(announce(USUAL, SETTLED))])
    first, second = tables
    assert first == ('stiffness', 'flexion')
    assert second == ('stiffness', 'flexion', SETTLED.digest)
    assert tables[first].spec == USUAL
    assert tables[second].spec == SETTLED
    assert name_table(first, tables[first]) == 'stiffness, flexion'
    assert name_table(second, tables[second]) == 'stiffness, flexion, stiffness_regression'
    alone = read_tables([record(announce(SETTLED), name='alone')])[first]
    assert alone.compute_sha256() == tables[second].compute_sha256()


def test_a_recording_with_messages_and_one_with_metadata_are_read_together(record, stiffness_bag):
    (table,) = read_tables([stiffness_bag, record(announce(GLIDE, USUAL))]).values()
    assert len(table) == 30


def test_recordings_can_be_combined_if_a_feature_set_is_named(record, stiffness_bag):
    other = record(announce(USUAL, SETTLED))
    with pytest.raises(BagError, match=r'other feature parameters.*or give --features'):
        read_tables([stiffness_bag, other])
    chosen = {'stiffness_features': 'stiffness_relaxation'}
    (table,) = read_tables([stiffness_bag, other], chosen).values()
    assert len(table) == 30


@pytest.fixture
def models(trained, tmp_path):
    folder = tmp_path / 'models'
    folder.mkdir()
    data = (trained / 'stiffness_flexion.npz').read_bytes()
    (folder / 'any name.npz').write_bytes(data)
    return folder


def record_models(record, folder, tmp_path, **changes):
    infos = [dataclasses.replace(info, **changes) for info in ModelSet.load(folder).infos]
    written_in = {WRITTEN_IN: str(tmp_path / 'bag')}
    return record((MODELS_TOPIC, model_infos_to_msg(ModelInfos(tuple(infos)))), **written_in)


def test_models_are_found_by_path_and_digest(record, models, tmp_path):
    path = record_models(record, models, tmp_path)
    with TactileBag(path) as bag:
        (info,) = recorded_models(bag)
        (file,) = find_models(bag)
        assert file == models / 'any name.npz'
        assert info.sha256 == hashlib.sha256(file.read_bytes()).hexdigest()
        assert gather_models([file], tmp_path) == file
        file.write_bytes(b'another')
        with pytest.raises(TactileError, match=r'changed since: .*any name\.npz; state --models'):
            find_models(bag)
        file.unlink()
        with pytest.raises(TactileError, match=r'is not at .*any name\.npz; state --models'):
            find_models(bag)


def test_models_that_moved_with_the_bag_are_found(record, models, tmp_path):
    path = record_models(record, models, tmp_path)
    moved = tmp_path / 'elsewhere'
    moved.mkdir()
    path.rename(moved / 'bag')
    models.rename(moved / 'models')
    with TactileBag(moved / 'bag') as bag:
        assert find_models(bag) == [moved / 'models' / 'any name.npz']


def test_several_models_are_copied_to_one_folder(trained, tmp_path):
    one = trained / 'stiffness_flexion.npz'
    other = tmp_path / one.name
    other.write_bytes(one.read_bytes())
    scratch = tmp_path / 'scratch'
    scratch.mkdir()
    folder = gather_models([one, other], scratch)
    assert [file.resolve() for file in sorted(folder.iterdir())] == [one, other]
    assert gather_models([], scratch) is None
    # Both files contain the same model, which is loaded once, with the path of the first file.
    (info,) = ModelSet.load(folder).infos
    assert info.path == str(one)
