# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""`tactile event`: publish one event of a trial from the shell."""

import time
from typing import Annotated, Any, Optional

import typer

from tactile_lab import options
from tactile_lab.output import Output
from tactile_ros.errors import TactileError
from tactile_ros.topics import EVENT_TOPIC, join_topic

PHASES = ('approach', 'contact', 'glide', 'hold', 'release', 'return', 'done', 'aborted')

SETTLING_S = 0.5
"""All subscribers are assumed to be known if no new one appears for this time [s]."""


def event(
    phase: Annotated[
        str, typer.Argument(**options.choice(*PHASES), help='The phase that begins now.')
    ],
    trial: Annotated[
        str,
        typer.Option(help='Name of the trial, such as grasp-1, which all of its events share.'),
    ],
    protocol: Annotated[
        str,
        typer.Option(
            **options.choice('', 'texture', 'stiffness'),
            help='Kind of trial. Default: texture for the phase glide, stiffness for the other '
            'phases. Give it for the other phases of a texture trial.',
            show_default=False,
        ),
    ] = '',
    contact: Annotated[
        str,
        typer.Option(
            **options.choice('', 'flexion', 'abduction'),
            help='How the finger touches. Default: not stated.',
            show_default=False,
        ),
    ] = '',
    object_label: Annotated[
        str, typer.Option('--object', help='Label of the object, for training. Default: unknown.')
    ] = '',
    session: Annotated[
        str, typer.Option(help='Session of the trial, for training. Default: not stated.')
    ] = '',
    mounting: Annotated[
        str, typer.Option(help='Mounting of the object, for training. Default: not stated.')
    ] = '',
    speed: Annotated[
        Optional[float],
        typer.Option(min=0.0, help='Sliding speed of a glide in mm/s. Default: not known.'),
    ] = None,
    why: Annotated[str, typer.Option(help='Reason why the trial is aborted.')] = '',
    namespace: options.NamespaceOption = '',
    wait_s: Annotated[
        float, typer.Option(min=0.0, help='Longest time to wait for a subscriber [s].')
    ] = 5.0,
    as_json: options.JsonOption = False,
) -> None:
    """Publish one event of a trial from the shell: a phase begins now.

    Use this command if you move the hand by other means than our trial runner. The event is
    published on the latched topic ``trial_runner/events`` (reliable, transient local). Its stamp
    is the time at which this command started, about 0.3 s after you press Enter. One touch
    consists of a **hold** or a **glide**, then a **release**, then **done**, all with the same
    ``--trial``. For exact stamps, let your program publish the message: see docs/on_your_hand.md.
    """
    stamp_ns = time.time_ns()
    from rclpy.node import Node

    from tactile_bringup.nodes.graph_runner import ros_context
    from tactile_features.conversions import event_to_msg
    from tactile_features.types import TrialEvent
    from tactile_msgs.msg import TrialEvent as TrialEventMsg
    from tactile_ros.qos import EVENTS

    topic = join_topic(namespace, EVENT_TOPIC.name)
    record = TrialEvent(
        stamp_ns,
        trial,
        session,
        protocol or ('texture' if phase == 'glide' else 'stiffness'),
        contact,
        object_label,
        phase,
        why,
        (speed or 0.0) / 1e3,
        mounting_id=mounting,
    )
    output = Output(as_json)
    with ros_context() as context:
        node = Node('tactile_event', context=context)
        try:
            publisher = node.create_publisher(TrialEventMsg, topic, EVENTS)
            publisher.publish(event_to_msg(record))
            names = _wait_for_subscribers(node, publisher, topic, wait_s)
        finally:
            node.destroy_node()
    output.say(f'{phase} of {trial} on {topic}, received by {", ".join(names)}')
    output.result({'topic': topic, 'stamp_ns': stamp_ns, 'received_by': names})


def _wait_for_subscribers(node: Any, publisher: Any, topic: str, wait_s: float) -> list[str]:
    """Wait until all subscribers have received the event; return their names."""
    from rclpy.duration import Duration

    known, changed_s = 0, time.monotonic()
    while time.monotonic() - changed_s < (SETTLING_S if known else wait_s):
        count = publisher.get_subscription_count()
        if count != known:
            known, changed_s = count, time.monotonic()
        time.sleep(0.02)
    if not known:
        others = [
            f' --namespace {name.removesuffix(EVENT_TOPIC.name)}'
            for name, _ in sorted(node.get_topic_names_and_types())
            if name.endswith(f'/{EVENT_TOPIC.name}') and name != topic
        ]
        others_run = f', or publish to another finger:{" or".join(others)}' if others else ''
        raise TactileError(
            f'no node subscribes to {topic}: start the nodes of the finger{others_run}'
        )
    if not publisher.wait_for_all_acked(Duration(seconds=max(1.0, wait_s))):
        raise TactileError(f'a subscriber of {topic} did not confirm the event; publish it again')
    return sorted(
        f'{info.node_namespace.rstrip("/")}/{info.node_name}'
        for info in node.get_subscriptions_info_by_topic(topic)
    )
