# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

# %%
# # Your own pipeline
#
# Train a scikit-learn pipeline with features and a classifier of your choice, test it on held-out sessions, write a model file,
# and classify with live nodes. Only the last part needs the ROS nodes (`./tactile run jupyter lab`, or any Python of ROS).
#
# The files here are SIMULATED: one for each window, `LABEL_SESSION_NUMBER.csv`, with 180 samples of tension [N] at 60 Hz.
import tempfile
from pathlib import Path

import numpy as np

scratch = tempfile.TemporaryDirectory()
folder = Path(scratch.name)
rng = np.random.default_rng(2)


def touch(pitch_hz, samples=180):
    time_s = np.arange(samples) / 60.0
    wave = np.sin(2 * np.pi * (pitch_hz * time_s + rng.random()))
    return 3.0 + 0.05 * wave + rng.normal(0.0, 0.01, samples)


for label, pitch_hz in (('rough', 4.0), ('smooth', 9.0)):
    for session in ('monday', 'tuesday', 'friday'):
        for number in range(10):
            np.savetxt(folder / f'{label}_{session}_{number}.csv', touch(pitch_hz))

# %%
# ## Arrays
#
# `X` has one window per row; `y` has the labels, and `session` the groups that are held out.
files = sorted(folder.glob('*.csv'))
X = np.array([np.loadtxt(file) for file in files])
y, session, _ = np.array([file.stem.split('_') for file in files]).T
print(X.shape, np.unique(y), np.unique(session))

# %%
# ## Features and classifier
#
# Each feature set is a scikit-learn transformer, which also returns the names of its features. `cross_val_score` holds out one
# session at a time.
from sklearn.model_selection import LeaveOneGroupOut, cross_val_score
from sklearn.neighbors import KNeighborsClassifier
from sklearn.pipeline import make_pipeline

from tactile_features.estimators import TextureSpectrum

pipe = make_pipeline(TextureSpectrum(rate_hz=60), KNeighborsClassifier(3))
print(cross_val_score(pipe, X, y, groups=session, cv=LeaveOneGroupOut()))
print(pipe[0].fit(X).get_feature_names_out()[:3])

# %%
# ## A model file
#
# `TactileClassifier` trains the pipeline as `tactile train` does: held-out sessions calibrate the probabilities and set the
# threshold for unknown objects.
from tactile_classifier import TactileClassifier

model = TactileClassifier(pipe).fit(X, y, groups=session)
model.save(folder / 'texture.npz')

# %%
# ## Labels
#
# `load_model` does not need scikit-learn, and the classifier node uses the same file (see below). `predict` always returns a label;
# `predict_or_unknown` returns *unknown* for windows that differ from all training windows.
from tactile_classifier import load_model

loaded = load_model(folder / 'texture.npz')
new = np.array([touch(4.0), touch(9.0), touch(20.0)])
print(loaded.predict(new))
print(loaded.predict_or_unknown(new))
print(loaded.p_value(new).round(2))

# %%
# A pipeline that cannot be stored in a model file is refused:
from sklearn.linear_model import LogisticRegression

try:
    TactileClassifier(make_pipeline(TextureSpectrum(rate_hz=60), LogisticRegression())).fit(X, y)
except ValueError as error:
    print(error)

# %%
# ## Live
#
# The same file in nodes: the feature node computes the features that the model needs, and the classifier node publishes the label.
# This is what `tactile sense --models FOLDER` runs. The program below takes the place of the sensor and of the hand: it publishes
# a SIMULATED glide, whose start and end are trial events. The windows of the model begin 0.6 s after the start of the glide.
from importlib.util import find_spec


def classify_live(tension_n):
    import time

    from rclpy.node import Node
    from tactile_bringup.launch_config.graph import ModelChoice, sensing_graph
    from tactile_bringup.nodes.graph_runner import ros_context, running_graph
    from tactile_msgs.msg import Classification, StrainBlock, TrialEvent
    from tactile_ros.qos import EVENTS, RESULTS, STREAM

    labels = []
    nodes = sensing_graph('none', ModelChoice.read(folder / 'texture.npz'), {})
    with ros_context() as context:
        hand = Node('hand', context=context)
        samples = hand.create_publisher(StrainBlock, 'tendon_sensor/strain', STREAM)
        events = hand.create_publisher(TrialEvent, 'trial_runner/events', EVENTS)
        hand.create_subscription(
            Classification,
            'tactile_classifier/classification',
            lambda message: labels.append(message.label),
            RESULTS,
        )
        with running_graph(nodes, context, others=[hand], quiet=True):
            while not (samples.get_subscription_count() and events.get_subscription_count()):
                time.sleep(0.05)
            begin_ns = hand.get_clock().now().nanoseconds

            def stamp(message, at_s):
                at_ns = begin_ns + round(at_s * 1e9)
                message.header.stamp.sec, message.header.stamp.nanosec = divmod(at_ns, 10**9)
                return message

            event = {'trial_id': 'live-1', 'protocol': 'texture', 'contact': 'flexion'}
            events.publish(stamp(TrialEvent(phase=TrialEvent.PHASE_GLIDE, **event), 0.0))
            period_ns = 16_666_667
            block = StrainBlock(period_ns=period_ns, tension_n=tension_n)
            block.status = StrainBlock.STATUS_SIMULATED
            samples.publish(stamp(block, 0.0))
            end_s = len(tension_n) * period_ns * 1e-9
            events.publish(stamp(TrialEvent(phase=TrialEvent.PHASE_DONE, **event), end_s))
            while not labels:
                time.sleep(0.05)
    return labels[0]


if find_spec('rclpy'):
    print(classify_live(touch(9.0, samples=300)))
