# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Diagnosis of a topic: faults of its publishers and stream, with remedies. Free of ROS."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from tendon_sensor_driver.topics.readings import READERS
from tendon_sensor_driver.topics.topic_stream import TopicStream

RATE_TOLERANCE = 0.02
"""Windows of a rate further off are refused."""

LARGEST_DELAY_S = 0.02
"""From there on, the shortest window of the texture protocol may be refused."""


class Publisher(NamedTuple):
    """One publisher of a topic, as the graph shows it.

    Attributes
    ----------
    node
        Its name, with namespace.
    type_name
        Such as ``std_msgs/msg/Float64``.
    objection
        Why it cannot reach the subscription, by quality of service; empty: it can.
    """

    node: str
    type_name: str
    objection: str = ''


def choose_type(publishers: Sequence[Publisher], present: str = '') -> str:
    """Return the type to subscribe to; empty when no publisher has one that is known.

    Parameters
    ----------
    publishers : sequence of Publisher
    present : str
        Type of the present subscription, which stays while somebody publishes it.
    """
    types = [publisher.type_name for publisher in publishers if publisher.type_name in READERS]
    return present if present in types else next(iter(types), '')


def describe_publishers(topic: str, publishers: Sequence[Publisher], type_name: str) -> str:
    """Return why nothing can come from the publishers of a topic; empty when something can.

    Parameters
    ----------
    topic : str
    publishers : sequence of Publisher
    type_name : str
        Type of the subscription; empty: there is none yet.
    """
    if not publishers:
        return (
            f'nobody publishes {topic}; start its publisher, or set "topic" to a name of '
            '"ros2 topic list -t"'
        )
    fitting = [publisher for publisher in publishers if publisher.type_name == type_name]
    if not fitting and choose_type(publishers):
        return f'{topic} was found just now and is not subscribed to yet; listen longer'
    if not fitting:
        types = ', '.join(sorted({publisher.type_name for publisher in publishers}))
        known = ', '.join(READERS)
        return f'{topic} is {types}, which holds no tension; it must be one of {known}'
    if all(publisher.objection for publisher in fitting):
        return (
            f'{fitting[0].node} publishes {topic} with another quality of service: '
            f'{fitting[0].objection}; change the publisher or the qos_overrides of this node'
        )
    return ''


def describe_stream(
    topic: str,
    stream: TopicStream,
    publishers: Sequence[Publisher],
    *,
    is_silent: bool,
    new_duplicates: int = 0,
    new_samples: int = 0,
) -> str:
    """Return what is wrong with what comes, with the remedy; empty when nothing is.

    Parameters
    ----------
    topic : str
    stream : TopicStream
    publishers : sequence of Publisher
    is_silent : bool
        Whether nothing has come for some time.
    new_duplicates, new_samples : int
        Of the last while: readings with the stamp of the one before, readings that count.
    """
    nodes = ', '.join(sorted({publisher.node for publisher in publishers}))
    if is_silent:
        return (
            f'{nodes} has the publisher of {topic} and sends nothing: see whether its controller '
            'is active'
        )
    if len(publishers) > 1:
        return (
            f'{topic} has {len(publishers)} publishers ({nodes}), whose samples mix; end all but '
            'one, or name a topic of its own'
        )
    if new_duplicates and not new_samples:
        return (
            'each message has the stamp of the one before; set topic_stamps to arrival, or have '
            'the publisher stamp them'
        )
    if stream.clock is not None and stream.clock.least_delay_ns is not None:
        delay_s = stream.clock.least_delay_ns / 1e9
        if abs(delay_s) > LARGEST_DELAY_S:
            way = 'behind' if delay_s > 0 else 'ahead of'
            return (
                f'the stamps are {abs(delay_s):.3f} s {way} the time of this node; synchronise '
                'the clocks of the computers, set use_sim_time as the publisher does, or set '
                'topic_stamps to arrival'
            )
    rate_hz, measured_hz = stream.rate_hz, stream.meter.rate_hz
    if rate_hz and measured_hz and abs(measured_hz - rate_hz) > RATE_TOLERANCE * rate_hz:
        return (
            f'{topic} comes at {measured_hz:.2f} Hz and rate_hz is {rate_hz:g}; set rate_hz to '
            f'{measured_hz:.4g}, here and in tactile_features'
        )
    return ''
