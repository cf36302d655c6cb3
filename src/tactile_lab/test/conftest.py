# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Small recordings, which are made once per test run."""

import builtins
from pathlib import Path
import sys

import pytest

from tactile_bags import BagWriter, TactileBag
from tactile_bringup.trial_protocols import TrialConfig
from tactile_features.config import FeatureConfig
from tactile_lab.simulation.simulated_bags import write_simulated_bag
from tactile_lab.simulation.simulated_trials import SimulationPlan
from tactile_ros.topics import RecordedTopic

# Helpers of several test files are in this folder, which is not part of the package.
sys.path.insert(0, str(Path(__file__).parent))


@pytest.fixture(scope='session')
def rewrite():
    """Return a function that writes a modified copy of a bag."""

    def rewrite(source, target, change, **metadata):
        """Copy a bag; ``change`` returns each message, or None to omit it."""
        with (
            TactileBag(source) as bag,
            BagWriter(target, {**bag.metadata, **metadata}) as writer,
        ):
            for name, (type_name, _) in bag.topics.items():
                writer.add_topic(RecordedTopic(name.strip('/'), type_name))
            for message in bag.messages():
                new = change(message.type_name, message.decode())
                if new is not None:
                    writer.write(message.topic, message.received_at_ns, new)
        return target

    return rewrite


@pytest.fixture(scope='session')
def simulate_bag(tmp_path_factory):
    """Return a function that writes a bag of simulated trials and returns its path."""

    def simulate_bag(protocol, contact, trials_per_label, **plan):
        plan = SimulationPlan(protocol, contact, trials_per_label, **plan)
        folder = tmp_path_factory.mktemp('bags')
        return write_simulated_bag(folder, plan, TrialConfig(), FeatureConfig()).path

    return simulate_bag


@pytest.fixture(scope='session')
def stiffness_bag(simulate_bag):
    """Return a bag of simulated stiffness trials: 3 on each of the 5 objects."""
    return simulate_bag('stiffness', 'flexion', 3, seed=7)


@pytest.fixture(scope='session')
def texture_bag(simulate_bag):
    """Return a bag of simulated texture trials: 2 on each of 8 plates in each of 2 sessions."""
    return simulate_bag('texture', 'flexion', 2, seed=5, sessions=2)


@pytest.fixture
def opened(monkeypatch):
    """Return the names of the data files that are opened, in the order of opening."""
    found = []
    for place, name in ((builtins, 'open'), (Path, 'open')):
        original = getattr(place, name)

        def spy(path, *arguments, original=original, **options):
            if str(path).endswith(('.mcap', '.db3')):
                found.append(str(path))
            return original(path, *arguments, **options)

        monkeypatch.setattr(place, name, spy)
    return found


@pytest.fixture(scope='session')
def trained(stiffness_bag, tmp_path_factory):
    """Return a folder with a model that was trained on `stiffness_bag`."""
    from tactile_analysis.datasets.feature_tables import read_tables
    from tactile_classifier.training.model_writer import write_model
    from tactile_classifier.training.trainer import train
    from tactile_lab.commands.train import model_path

    folder = tmp_path_factory.mktemp('models')
    for (task, contact), table in read_tables([stiffness_bag]).items():
        write_model(model_path(folder, (task, contact)), train(table, 'knn'))
    return folder
