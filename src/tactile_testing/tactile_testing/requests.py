# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Sends requests to nodes under test, such as service calls and action goals."""

import concurrent.futures


def send(node, request):
    """Send a request on the thread of the node's executor; return a future of the answer.

    ``request`` is a function that sends the request and returns a future of rclpy, for example
    ``lambda: client.send_goal_async(goal)``. The node must be spun by an executor on another
    thread.

    The request is not sent on the calling thread, because an action client of rclpy registers a
    request after it has sent it. The executor could receive the answer before, and would drop it.
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
