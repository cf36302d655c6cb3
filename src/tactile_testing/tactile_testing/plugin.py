# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Plugin of pytest: fixtures of several packages, and the surroundings of programs under test.

Each package names it in ``setup.cfg``, so that ``colcon test`` and ``pytest`` load it alike.
Programs have a ROS domain of this process's own, and hear Ctrl-C.
"""

import gc
import os
import signal

from hypothesis import settings
import pytest

# An example that takes long on a busy computer is not wrong.
settings.register_profile('untimed', deadline=None)
settings.load_profile('untimed')

# A script's background ignores Ctrl-C, and nohup a closed terminal; programs would inherit it.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
    signal.signal(signal.SIGHUP, signal.SIG_DFL)


def pytest_configure(config):
    """Let a test fail if a thread ends with an exception."""
    failing = 'error::pytest.PytestUnhandledThreadExceptionWarning'
    config.addinivalue_line('filterwarnings', failing)


def pytest_collection_finish():
    """Keep garbage collections short, as `tactile_ros.process.short_collections` does.

    Nodes under test must not pause because this process has imported many modules.
    """
    gc.collect()
    gc.freeze()


@pytest.fixture(scope='session', autouse=True)
def domain_of_programs():
    """Isolate the programs of one test process from other test processes."""
    try:
        from domain_coordinator import domain_id
    except ImportError:  # without ROS
        yield
        return
    with domain_id() as domain:
        os.environ['ROS_DOMAIN_ID'] = str(int(domain))
        yield


@pytest.fixture
def parameter_file(tmp_path):
    """Return a function that writes a file of parameters and returns its path."""

    def write(text):
        path = tmp_path / 'params.yaml'
        path.write_text(text)
        return path

    return write


@pytest.fixture
def context():
    """Return a ROS context on a separate domain."""
    from domain_coordinator import domain_id
    import rclpy
    from rclpy.context import Context

    with domain_id() as domain:
        context = Context()
        rclpy.init(context=context, domain_id=int(domain))
        yield context
        rclpy.try_shutdown(context=context)
