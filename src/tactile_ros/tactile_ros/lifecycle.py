# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Base class of all nodes: lifecycle, parameters from a Config class, guarded subscriptions."""

from __future__ import annotations

from collections.abc import Callable
import copy
import dataclasses
import functools
import threading
import time
from typing import Any, TypeVar

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.logging import LoggingSeverity
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from rclpy.qos_overriding_options import QoSOverridingOptions

from tactile_ros.configs import find_violation
from tactile_ros.errors import MessageError
from tactile_ros.periodic import Periodic, SLOW_CALLS, Ticker
from tactile_ros.qos import STREAM
from tactile_ros.rclpy_internals import (
    change_state_service,
    destroy_state_machine,
    parameter_overrides,
    RCLError,
    run_on_executor,
)

LOG_PERIOD_S = 10.0
"""Shortest time between two log messages about message faults of the same kind [s]."""

SHOWN_S = 10.0
"""Time for which diagnostics warn about a refused or unpublished message [s]."""


class MessageGuard:
    """Keeps a node running if a message cannot be converted or published.

    If a callback raises `MessageError`, the message is refused and the node continues. Every
    other exception is a fault of the program and ends the node.

    Fast DDS sometimes cannot publish a message while a process that subscribes to its topic ends
    (ros2/rmw_fastrtps issue 310). Such a message is published once more; if this fails too, the
    message is lost, as on a network, and the node continues.

    Attributes
    ----------
    refused, unpublished : MessageFaults
        The messages that were refused, and those that could not be published.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self.refused = MessageFaults(node, 'refused a message')
        self.unpublished = MessageFaults(node, 'could not publish a message')

    def wrap(self, topic: str, callback: Callable[..., Any]) -> Callable[..., Any]:
        """Return a callback for a subscription that refuses messages on `MessageError`."""

        @functools.wraps(callback)  # rclpy inspects the signature
        def guarded(*arguments: Any) -> None:
            try:
                callback(*arguments)
            except MessageError as error:
                self.refuse(topic, error)

        return guarded

    def refuse(self, topic: str, reason: object) -> None:
        """Count and log a refused message."""
        self.refused.add(topic, reason)

    def wrap_publish(self, topic: str, publish: Callable[[Any], None]) -> Callable[[Any], None]:
        """Return a replacement for a publisher's method ``publish``.

        It counts and logs a message that cannot be published, instead of raising an exception.
        """

        def guarded(message: Any) -> None:
            try:
                publish(message)
            except RCLError:
                if not self._node.context.ok():
                    raise
                try:
                    publish(message)
                except RCLError as error:
                    self.unpublished.add(topic, error)

        return guarded

    @property
    def warning(self) -> str | None:
        """Warning about a message that was refused or lost less than `SHOWN_S` ago, or None."""
        return self.refused.warning or self.unpublished.warning

    @property
    def values(self) -> dict[str, object]:
        """Values for diagnostics: the number of faults of each kind, and the last reason."""
        values: dict[str, object] = {}
        if self.refused.count:
            values['refused_messages'] = self.refused.count
            values['last_refused_message'] = self.refused.last_reason
        if self.unpublished.count:
            values['unpublished_messages'] = self.unpublished.count
            values['last_unpublished_message'] = self.unpublished.last_reason
        return values


class MessageFaults:
    """Counts and logs messages with one kind of fault.

    Attributes
    ----------
    count : int
        Number of these messages since the node was created.
    last_reason : str
        Topic of the last of these messages, and the reason.
    """

    def __init__(self, node: Node, what: str) -> None:
        self._node, self._what = node, what
        self.count = 0
        self.last_reason = ''
        self._at_s: float | None = None
        self._logged_at_s: float | None = None

    def add(self, topic: str, reason: object) -> None:
        """Count a message, and log it unless another was logged within `LOG_PERIOD_S`."""
        now_s = time.monotonic()
        self.count += 1
        self.last_reason = f'{topic}: {reason}'
        self._at_s = now_s
        if self._logged_at_s is None or now_s - self._logged_at_s >= LOG_PERIOD_S:
            self._logged_at_s = now_s
            self._node.get_logger().error(
                f'{self._what} on {self.last_reason} (messages so far: {self.count})'
            )

    @property
    def warning(self) -> str | None:
        """Warning about the last fault if it happened less than `SHOWN_S` ago, or None."""
        if self._at_s is None or time.monotonic() - self._at_s > SHOWN_S:
            return None
        return f'{self._what} on {self.last_reason}'


Config = TypeVar('Config')

REMEDY = 'deactivate and clean up the node first'


def describe_field(field: dataclasses.Field[Any]) -> ParameterDescriptor:
    """Return the parameter descriptor of a Config field."""
    metadata = field.metadata
    text = metadata['description']
    if metadata.get('unit'):
        text += f' [{metadata["unit"]}]'
    if metadata.get('choices'):
        text += f'; one of {", ".join(map(str, metadata["choices"]))}'
    descriptor = ParameterDescriptor(name=field.name, description=text)
    if not metadata.get('live'):
        descriptor.additional_constraints = f'read when the node is configured; {REMEDY}'
    if 'range' in metadata:
        low, high = metadata['range']
        if isinstance(field.default, float):
            descriptor.floating_point_range = [
                FloatingPointRange(from_value=float(low), to_value=float(high))
            ]
        else:
            descriptor.integer_range = [IntegerRange(from_value=int(low), to_value=int(high))]
    return descriptor


def declare_config(node: Node, config_class: type[Config]) -> None:
    """Declare a parameter for every field of ``config_class``.

    While the node's ``is_configured`` is True, only live parameters can be changed.

    Raises
    ------
    rclpy.exceptions.InvalidParameterValueException
        If an override is out of range or has the wrong type.
    """
    for field in dataclasses.fields(config_class):  # type: ignore[arg-type]
        default = list(field.default) if isinstance(field.default, tuple) else field.default
        if default == []:  # its type cannot be inferred
            default = Parameter.Type.STRING_ARRAY
        overrides = parameter_overrides(node)
        if field.name in overrides:
            overrides[field.name] = _with_float(field, overrides[field.name])
        node.declare_parameter(field.name, default, describe_field(field))

    fields = {f.name: f for f in dataclasses.fields(config_class)}  # type: ignore[arg-type]

    def convert(parameters: list[Parameter]) -> list[Parameter]:
        return [_with_float(fields[p.name], p) if p.name in fields else p for p in parameters]

    node.add_pre_set_parameters_callback(convert)

    def check(parameters: list[Parameter]) -> SetParametersResult:
        known = ((fields[p.name], p) for p in parameters if p.name in fields)
        reasons = (_find_violation(node, field, parameter) for field, parameter in known)
        reason = next(filter(None, reasons), None)
        return SetParametersResult(successful=reason is None, reason=reason or '')

    node.add_on_set_parameters_callback(check)


def _with_float(field: dataclasses.Field[Any], parameter: Parameter) -> Parameter:
    """Return the parameter, converted from an integer to a float if the field is a float."""
    if isinstance(field.default, float) and parameter.type_ == Parameter.Type.INTEGER:
        return Parameter(parameter.name, value=float(parameter.value))
    return parameter


def _find_violation(node: Node, field: dataclasses.Field[Any], parameter: Parameter) -> str | None:
    """Return why a parameter cannot be set to a value, or None."""
    if violation := find_violation(field, parameter.value):
        return violation
    if not node.is_configured or field.metadata.get('live'):
        return None
    # An unchanged value is accepted, so that a parameter file can be loaded again.
    present = node.get_parameter_or(field.name, None)
    if present is not None and present.get_parameter_value() == parameter.get_parameter_value():
        return None
    return f'{parameter.name} is read when the node is configured: {REMEDY}'


def read_config(node: Node, config_class: type[Config]) -> Config:
    """Return a Config with the parameters' present values.

    Raises
    ------
    ValueError
        If a value is not one of the field's choices, or ``__post_init__`` refuses it.
    """
    values = {}
    for field in dataclasses.fields(config_class):  # type: ignore[arg-type]
        value: Any = node.get_parameter_or(field.name, None)
        value = field.default if value is None or value.value is None else value.value
        if isinstance(field.default, tuple):
            value = tuple(value)
        if violation := find_violation(field, value):
            raise ValueError(violation)
        values[field.name] = value
    return config_class(**values)


class TactileNode(LifecycleNode):
    """A lifecycle node whose parameters are the fields of a Config class.

    The constructor declares the parameters. A subclass overrides some of these methods:

    ``set_up(config)``
        Called on configure: create publishers and subscriptions, open devices. An exception
        refuses the transition and is logged.
    ``start()``, ``stop()``
        Called on activate and deactivate: start or stop the data flow.
    ``on_goal_end()``
        Called on the executor's thread when the work of a goal has ended, before the result is
        sent.
    ``tear_down()``
        Called on cleanup, shutdown, error, and at the end of the process: release everything.
        Must be idempotent, and work after an incomplete ``set_up``.

    Parameters
    ----------
    name : str
        Name of the node.
    config_class : type
        Frozen dataclass; see `tactile_ros.configs`.
    **node_options
        Passed to `rclpy.lifecycle.LifecycleNode`.

    Attributes
    ----------
    is_finished, has_failed : bool
        Set by a node whose work has an end, such as a recording. The process then ends, with
        exit code 1 if ``has_failed`` is True.
    is_quiet : bool
        Only requests wake the executor of the node, so that several such nodes can share one
        executor.
    is_configured : bool
        True from the start of configure to the end of cleanup. During this time, only parameters
        that are marked as ``live`` can be changed.
    ending : threading.Event
        Set when the process must end. Long waits in ``set_up`` must wait for this event.
    message_guard : MessageGuard
        Handles every `MessageError` that a subscription's callback raises, and every message that
        a publisher of the node cannot publish.
    """

    is_finished = False
    is_quiet = False
    has_failed = False
    is_configured = False

    def __init__(self, name: str, config_class: type, **node_options: Any) -> None:
        self.ending = threading.Event()
        self._periodics: list[Periodic] = []
        self._is_destroyed = False
        self.message_guard = MessageGuard(self)
        super().__init__(name, **node_options)
        self._config_class = config_class
        declare_config(self, config_class)
        self.declare_parameter(
            'autostart',
            True,
            ParameterDescriptor(
                description='configure and activate when the process starts', read_only=True
            ),
        )
        self.config: Any = None
        self.goal_runners: list[Any] = []
        self.is_active = False
        self._refuse_impossible_transitions()

    # -- for subclasses ----------------------------------------------------------

    def create_subscription(
        self, message_type: Any, topic: str, callback: Callable[..., Any], *args: Any, **opts: Any
    ) -> Any:
        """Create a subscription that refuses messages if the callback raises `MessageError`."""
        guarded = self.message_guard.wrap(topic, callback)
        return super().create_subscription(message_type, topic, guarded, *args, **opts)

    def create_publisher(self, message_type: Any, topic: str, *args: Any, **opts: Any) -> Any:
        """Create a publisher that logs a message that cannot be published, and continues."""
        publisher = super().create_publisher(message_type, topic, *args, **opts)
        publisher.publish = self.message_guard.wrap_publish(topic, publisher.publish)
        return publisher

    def create_lifecycle_publisher(
        self, message_type: Any, topic: str, *args: Any, **opts: Any
    ) -> Any:
        """Create a lifecycle publisher that logs a message that cannot be published."""
        publisher = super().create_lifecycle_publisher(message_type, topic, *args, **opts)
        publisher.publish = self.message_guard.wrap_publish(topic, publisher.publish)
        return publisher

    def create_stream_publisher(
        self, message_type: Any, topic: str, profile: QoSProfile = STREAM
    ) -> Any:
        """Create a lifecycle publisher whose QoS can be overridden by parameters.

        An example is ``qos_overrides./tendon_sensor/strain.publisher.reliability``.
        """
        return self.create_lifecycle_publisher(
            message_type,
            topic,
            copy.copy(profile),  # rclpy writes the overrides into the profile
            qos_overriding_options=QoSOverridingOptions.with_default_policies(),
        )

    def call_every(self, period_s: float, callback: Callable[[], object]) -> Periodic:
        """Call ``callback`` every ``period_s`` [s] of the monotonic clock.

        The callback runs on the thread of periodic calls, until the returned `Periodic` is
        cancelled or the node is destroyed. Its exceptions end the node's executor, like exceptions
        of the node's other callbacks.
        """
        return self._call_on(SLOW_CALLS, period_s, callback)

    def _call_on(
        self, ticker: Ticker, period_s: float, callback: Callable[[], object]
    ) -> Periodic:
        def call() -> None:
            try:
                callback()
            except Exception as error:
                periodic.cancel()
                if self.context.ok() and not self._is_destroyed:
                    self._fail(error)

        periodic = ticker.every(period_s, call)
        self._periodics = [known for known in self._periodics if known.is_running] + [periodic]
        return periodic

    def _fail(self, error: Exception) -> None:
        """End the executor with an exception that was raised on another thread."""

        def fail() -> None:
            raise error

        try:
            run_on_executor(self, fail)
        except RuntimeError:
            self.get_logger().fatal(f'a callback failed: {error!r}')

    def set_up(self, config: Any) -> None: ...

    def start(self) -> None: ...

    def stop(self) -> None: ...

    def on_goal_end(self) -> None: ...

    def tear_down(self) -> None: ...

    # -- transitions ---------------------------------------------------------------

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        self.is_configured = True
        try:
            self.config = read_config(self, self._config_class)
            self.set_up(self.config)
        except Exception as error:
            self.get_logger().error(f'cannot configure: {error}')
            self._release()
            return TransitionCallbackReturn.FAILURE
        return TransitionCallbackReturn.SUCCESS

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        result = super().on_activate(state)
        try:
            self.start()
        except Exception as error:
            self.get_logger().error(f'cannot activate: {error}')
            super().on_deactivate(state)
            return TransitionCallbackReturn.FAILURE
        self.is_active = True
        return result

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        self.is_active = False
        self.stop()
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        if any(runner.is_busy for runner in self.goal_runners):
            # Do not wait for the goal here, because this would block the executor. The executor
            # must send the result of the goal, and the goal may need the executor to end.
            self.get_logger().error(
                'cannot clean up: a goal is still ending; try again when it has ended'
            )
            return TransitionCallbackReturn.FAILURE
        self._release()
        return TransitionCallbackReturn.SUCCESS

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        self._stop_and_tear_down()
        return TransitionCallbackReturn.SUCCESS

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        return self.on_shutdown(state)

    # -- use --------------------------------------------------------------------------

    def bring_up(self) -> bool:
        """Configure and activate the node; return False if this fails or the process is ending."""
        for transition in (self.trigger_configure, self.trigger_activate):
            if self.ending.is_set() or transition() != TransitionCallbackReturn.SUCCESS:
                return False
        return True

    def take_down(self) -> None:
        """Stop the node, release its resources and destroy it, in any lifecycle state."""
        try:
            self._stop_and_tear_down()
        finally:
            self.destroy_node()

    def destroy_node(self) -> None:
        self._is_destroyed = True
        for periodic in self._periodics:
            periodic.cancel()
        # A log level is stored for the name of a node, so reset it for the next node with this
        # name.
        self.get_logger().set_level(LoggingSeverity.UNSET)
        super().destroy_node()
        destroy_state_machine(self)

    def _refuse_impossible_transitions(self) -> None:
        """Answer requests for invalid transitions with ``success: false``.

        rclpy raises an exception instead. The caller would then get no answer, and the executor
        would drop the requests that arrived together with this one.
        """
        service = change_state_service(self)
        change_state = service.callback

        def answer(request: Any, response: Any) -> Any:
            try:
                return change_state(request, response)
            except RCLError as error:
                self.get_logger().error(f'the requested transition is not possible: {error}')
                response.success = False
                return response

        service.callback = answer

    def _stop_and_tear_down(self) -> None:
        try:
            if self.is_active:
                self.is_active = False
                self.stop()
        finally:
            self._release()

    def _release(self) -> None:
        self.tear_down()
        self.is_configured = False
