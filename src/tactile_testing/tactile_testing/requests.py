# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Requests of a test to a node."""

import concurrent.futures


def send(node, request):
    """Send a request of ``node`` on the executor's thread; return a future of the answer.

    ``request()`` sends it and returns rclpy's future, for example
    ``lambda: client.send_goal_async(goal)``. An executor on another thread must spin the node. An
    action client of rclpy registers a request only after sending it. If another thread sent the
    request, the executor could receive the answer before that, and drop it.
    """
    answer = concurrent.futures.Future()

    def pass_on(future):
        try:
            answer.set_result(future.result())
        except Exception as error:
            answer.set_exception(error)

    def start():
        try:
            request().add_done_callback(pass_on)
        except Exception as error:
            answer.set_exception(error)

    node.executor.create_task(start)
    return answer
