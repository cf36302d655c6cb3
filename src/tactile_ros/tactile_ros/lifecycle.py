# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""The lifecycle that all nodes share, and their ``main``."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn

from tactile_ros.parameters import declare_config, read_config


class TactileNode(LifecycleNode):
    """A lifecycle node whose parameters are the fields of a Config class.

    The constructor declares. A subclass says what else happens:

    ``set_up(config)``
        configure: build publishers and subscriptions, open devices. What it
        raises refuses the transition; the message is logged.
    ``start()`` / ``stop()``
        activate / deactivate: let the data flow, or not.
    ``tear_down()``
        cleanup, shutdown, error, end of the process: give everything back. Must
        be harmless when called twice or after a ``set_up`` that failed half way.

    Parameters
    ----------
    name : str
        Default node name.
    config_class : type
        Frozen dataclass; see `tactile_ros.parameters`.
    node_options
        Passed on to `rclpy.lifecycle.LifecycleNode`.
    """

    def __init__(self, name: str, config_class: type, **node_options: Any) -> None:
        super().__init__(name, **node_options)
        self._config_class = config_class
        declare_config(self, config_class)
        self.declare_parameter('autostart', True)
        self.config: Any = None
        self.is_active = False

    # -- for subclasses ----------------------------------------------------------

    def set_up(self, config: Any) -> None: ...

    def start(self) -> None: ...

    def stop(self) -> None: ...

    def tear_down(self) -> None: ...

    # -- transitions ---------------------------------------------------------------

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        try:
            self.config = read_config(self, self._config_class)
            self.set_up(self.config)
        except Exception as error:
            self.get_logger().error(f'cannot configure: {error}')
            self.tear_down()
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
        self.tear_down()
        return TransitionCallbackReturn.SUCCESS

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        if self.is_active:
            self.is_active = False
            self.stop()
        self.tear_down()
        return TransitionCallbackReturn.SUCCESS

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        return self.on_shutdown(state)

    # -- use --------------------------------------------------------------------------

    def bring_up(self) -> bool:
        """Configure and activate; return whether both succeeded."""
        return (
            self.trigger_configure() == TransitionCallbackReturn.SUCCESS
            and self.trigger_activate() == TransitionCallbackReturn.SUCCESS
        )

    def take_down(self) -> None:
        """Stop, give everything back and destroy the node, from any state."""
        if self.is_active:
            self.is_active = False
            self.stop()
        self.tear_down()
        self.destroy_node()


def run_node(factory: Callable[[], TactileNode], args: list[str] | None = None) -> int:
    """Run one node until it is told to stop; return the process's exit code.

    With the parameter ``autostart`` (the default) the node configures and
    activates itself; a node that cannot exits with 1. Without, it waits for a
    lifecycle manager.
    """
    node = None
    executor = None
    try:
        rclpy.init(args=args)
        node = factory()
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        if node.get_parameter('autostart').value and not node.bring_up():
            return 1
        executor.spin()
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        if node is not None:
            node.take_down()
        if executor is not None:
            executor.shutdown()
        rclpy.try_shutdown()
    return 0
