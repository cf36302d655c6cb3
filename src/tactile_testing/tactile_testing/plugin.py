# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Pytest plugin: fixtures for several packages, and the environment of programs under test.

``setup.cfg`` of each package names this plugin, so both ``colcon test`` and ``pytest`` load it.
The programs under test run in a ROS domain that only this process uses, and react to Ctrl-C.
"""

import gc
import os
import signal

from hypothesis import settings
import pytest

# No test fails because an example of Hypothesis takes long, as on a busy computer.
settings.register_profile('untimed', deadline=None)
settings.load_profile('untimed')

# If pytest runs in the background of a shell script, it ignores SIGINT, and with nohup it ignores
# SIGHUP. The programs under test would inherit this, so the default handlers are restored.
signal.signal(signal.SIGINT, signal.default_int_handler)
signal.signal(signal.SIGHUP, signal.SIG_DFL)


# pytest-xdist already runs one process per core, so joblib must not start further processes by
# default. Tests of parallel computation set the number of jobs explicitly.
os.environ.setdefault('LOKY_MAX_CPU_COUNT', '1')


def pytest_configure(config):
    """Make a test fail if one of its threads ends with an exception."""
    failing = 'error::pytest.PytestUnhandledThreadExceptionWarning'
    config.addinivalue_line('filterwarnings', failing)


def pytest_collection_finish():
    """Exclude the imported modules from garbage collections, as in `tactile_ros.process`.

    This makes the collections short, so that they hardly delay the nodes under test.
    """
    gc.collect()
    gc.freeze()


@pytest.fixture(scope='session', autouse=True)
def domain_of_programs():
    """Run the programs under test on a ROS domain that only this process uses."""
    try:
        from domain_coordinator import domain_id
    except ImportError:  # ROS is not installed
        yield
        return
    with domain_id() as domain:
        os.environ['ROS_DOMAIN_ID'] = str(int(domain))
        yield


@pytest.fixture
def parameter_file(tmp_path):
    """Return a function that writes a parameter file and returns its path."""

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
