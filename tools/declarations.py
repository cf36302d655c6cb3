# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Check that each package declares exactly the dependencies that it imports.

Dependencies are declared in ``package.xml``, which contains ROS packages and rosdep keys, and in
``setup.py``, which contains the names of distributions on PyPI. Imports within functions also
count, and so do names of message types in strings, such as ``std_msgs/msg/Header``, because
message classes are imported by name.

Packages that run on a robot must only depend on packages that rosdep installs with apt.

``requirements/packages.txt`` contains a lower bound for the version of each package that pip
installs. The lower bounds in each ``setup.py`` and ``package.xml``, and the versions in
``requirements/noble.txt``, must be the same.
"""

from __future__ import annotations

import ast
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
import re
import sys
import xml.etree.ElementTree as ElementTree

ROOT = Path(__file__).resolve().parent.parent


@dataclass(frozen=True)
class Library:
    """The names with which a library from PyPI is declared as a dependency.

    Attributes
    ----------
    key : str
        Key of rosdep, for ``package.xml``. It is empty if rosdep has no key for the library, so
        that the user must install it.
    distribution : str
        Name in ``setup.py``.
    """

    key: str
    distribution: str


LIBRARIES = {
    'aiohttp': Library('python3-aiohttp', 'aiohttp'),
    'dynamixel_sdk': Library('dynamixel_sdk', 'dynamixel-sdk'),
    'hypothesis': Library('python3-hypothesis', 'hypothesis'),
    'jinja2': Library('python3-jinja2', 'Jinja2'),
    'joblib': Library('python3-joblib', 'joblib'),
    'lz4': Library('python3-rosbags-pip', 'lz4'),  # installed as a dependency of rosbags
    'matplotlib': Library('python3-matplotlib', 'matplotlib'),
    'mcap': Library('', 'mcap'),
    'numba': Library('python3-numba', 'numba'),
    'numpy': Library('python3-numpy', 'numpy'),
    'pandas': Library('python3-pandas', 'pandas'),
    'pyarrow': Library('', 'pyarrow'),
    'pytest': Library('python3-pytest', 'pytest'),
    'rich': Library('python3-rich', 'rich'),
    'rosbags': Library('python3-rosbags-pip', 'rosbags'),
    'scipy': Library('python3-scipy', 'scipy'),
    'serial': Library('python3-serial', 'pyserial'),
    'sklearn': Library('python3-sklearn', 'scikit-learn'),
    'threadpoolctl': Library('python3-sklearn', 'threadpoolctl'),  # dependency of scikit-learn
    'typer': Library('python3-typer', 'typer'),
    'yaml': Library('python3-yaml', 'PyYAML'),
    'zstandard': Library('python3-rosbags-pip', 'zstandard'),  # as lz4
}
"""Libraries from PyPI by import name. Modules with other names are ROS packages."""

ROBOT = (
    'tactile_msgs',
    'tactile_ros',
    'tendon_sensor_driver',
    'linear_guide_driver',
    'tactile_features',
    'tactile_classifier',
    'tactile_bringup',
)
"""Packages that run on a robot. All their dependencies must be installable with apt."""

OPTIONAL = {
    'tactile_bringup': {'tactile_bags', 'tactile_sim'},
}
"""Optional dependencies of each package, which it imports only where they are used."""

DEPENDENCIES = ('depend', 'build_depend', 'build_export_depend', 'exec_depend', 'test_depend')
"""Tags of the elements in ``package.xml`` that contain dependencies for rosdep."""

REMEDY = 'packages that run on a robot may only depend on packages that apt can install'

NOT_INSTALLED_BY_PIP = {'tactile_testing'}
"""Packages that are only used by tests and are not part of the wheel."""

NOT_IMPORTED = {
    'tactile_bringup': {'ros2launch'},  # provides the command `ros2 launch`
}
"""Dependencies that a package needs but does not import."""

TYPE_NAME = re.compile(r'(\w+)/(?:msg|srv|action)/\w+')


def imports_of(files: Iterable[Path], own: set[str], *, on_import: bool = False) -> set[str]:
    """Return the top-level packages imported by Python files, without the standard library.

    Parameters
    ----------
    files : iterable of Path
    own : set of str
        Names to ignore, which are the package itself and the helper modules of its tests.
    on_import : bool
        If True, ignore imports within functions and imports for type checking.
    """
    found = set()
    for path in files:
        for node in _walk(ast.parse(path.read_text('utf-8')), on_import=on_import):
            if isinstance(node, ast.Import):
                found |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
                found.add(node.module)
            elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                found |= {match[1] for match in [TYPE_NAME.fullmatch(node.value)] if match}
    return {name.partition('.')[0] for name in found} - own - set(sys.stdlib_module_names)


def _walk(tree: ast.AST, *, on_import: bool) -> Iterator[ast.AST]:
    """Yield the nodes of a syntax tree. With ``on_import``, omit code not run by an import."""
    if on_import:
        if isinstance(tree, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
            return
        if isinstance(tree, ast.If) and getattr(tree.test, 'id', '') == 'TYPE_CHECKING':
            return
    yield tree
    for child in ast.iter_child_nodes(tree):
        yield from _walk(child, on_import=on_import)


def keys_of(package_xml: Path, *tags: str) -> set[str]:
    """Return the texts of all elements with these tags in a ``package.xml``."""
    root = ElementTree.parse(package_xml).getroot()
    return {(element.text or '').strip() for tag in tags for element in root.iter(tag)}


def requirements_of(setup_py: Path) -> set[str]:
    """Return ``install_requires``."""
    for node in ast.walk(ast.parse(setup_py.read_text('utf-8'))):
        if isinstance(node, ast.Call) and getattr(node.func, 'id', '') == 'setup':
            stated = {k.arg: k.value for k in node.keywords}
            return set(ast.literal_eval(stated['install_requires']))
    raise SystemExit(f'{setup_py} calls no setup()')


def name_of(requirement: str) -> str:
    """Return the name in a requirement, without version and comment."""
    return re.split('[#<>=; ]', requirement)[0].strip()


def read_requirements(name: str) -> dict[str, str]:
    """Return the lines of a file in ``requirements/`` by the name of the distribution."""
    lines = (ROOT / 'requirements' / name).read_text('utf-8').splitlines()
    found = [line.partition('#')[0].strip() for line in lines]
    return {name_of(line): line for line in reversed(found) if line}


def check_bounds(folders: Iterable[Path]) -> list[str]:
    """Return an error message for each lower bound that differs between files."""
    wanted = read_requirements('packages.txt')
    bounds = {name: line.partition('>=')[2] for name, line in wanted.items()}
    # Several libraries can have the same rosdep key. The bound of the first one is then used.
    of_keys: dict[str, str] = {}
    for library in LIBRARIES.values():
        of_keys.setdefault(library.key, bounds.get(library.distribution, ''))
    of_keys['python3-rosbags-pip'] = bounds['rosbags']  # here, lz4 is the first one
    faults = []
    for folder in folders:
        faults += [
            f'src/{folder.name}/setup.py has {line}, requirements/packages.txt {wanted[name]}'
            for line in sorted(requirements_of(folder / 'setup.py'))
            if (name := name_of(line)) in wanted and line != wanted[name]
        ]
        for element in ElementTree.parse(folder / 'package.xml').getroot().iter('exec_depend'):
            key, stated = (element.text or '').strip(), element.get('version_gte', '')
            if key in of_keys and stated != of_keys[key]:
                faults.append(
                    f'src/{folder.name}/package.xml has version_gte="{stated}" for {key}, '
                    f'requirements/packages.txt "{of_keys[key]}"'
                )
    for name, line in read_requirements('noble.txt').items():
        tested = re.split('==|;', line)[1].strip()
        if bounds.get(name) and not f'{tested}.'.startswith(f'{bounds[name]}.'):
            faults.append(f'requirements/noble.txt tests {line}, packages.txt says {wanted[name]}')
    return faults


def check_package(folder: Path) -> list[str]:
    """Return an error message for each undeclared import and each unused declaration."""
    name = folder.name
    optional = OPTIONAL.get(name, set())
    files = list((folder / 'test').rglob('*.py'))
    code = imports_of([*(folder / name).rglob('*.py'), *folder.glob('launch/*.py')], {name})
    plugin = {'tactile_testing'} - {name}  # named in each setup.cfg
    tests = imports_of(files, {name} | {path.stem for path in files}) | plugin
    keys = _keys(code - optional)
    stated = keys_of(folder / 'package.xml', 'depend', 'exec_depend')
    for_tests = keys_of(folder / 'package.xml', 'test_depend')
    required = set(map(name_of, requirements_of(folder / 'setup.py')))
    lists = {
        # Each tuple contains the required, the declared, and the additionally allowed names.
        'exec_depend of package.xml': (keys, stated, NOT_IMPORTED.get(name, set())),
        'test_depend of package.xml': (
            _keys(tests - optional) - keys,
            for_tests,
            _keys(optional | (tests - code)),
        ),
        'install_requires of setup.py': (_pypi(code - optional), required, {'setuptools'}),
    }
    faults = []
    for place, (needed, found, allowed) in lists.items():
        faults += [f'{place} lacks {key}' for key in sorted(needed - found)]
        faults += [
            f'{place} contains {key}, which is not imported: remove it'
            for key in sorted(found - needed - allowed)
        ]
    faults += [
        f'{module} is not imported: remove it from OPTIONAL in tools/declarations.py'
        for module in sorted(optional - code)
    ]
    # Without this option, `colcon test` and `pytest src/PACKAGE/test` would lack fixtures.
    if files and '-p tactile_testing.plugin' not in (folder / 'setup.cfg').read_text('utf-8'):
        faults.append('[tool:pytest] of setup.cfg lacks -p tactile_testing.plugin in addopts')
    return [f'src/{name}: {fault}' for fault in faults]


def check_robot() -> list[str]:
    """Return an error message for each dependency of a robot package that apt cannot install.

    Packages of this repository on which the robot packages or their tests depend are also checked.
    """
    only_pip = {
        module
        for module, library in LIBRARIES.items()
        if not library.key or library.key.endswith('-pip')
    }
    faults = []
    waiting, seen = list(ROBOT), set(ROBOT)
    while waiting:
        name = waiting.pop()
        folder = ROOT / 'src' / name
        stated = keys_of(folder / 'package.xml', *DEPENDENCIES)
        faults += [
            f'src/{name}/package.xml contains {key}, which rosdep installs with pip: {REMEDY}'
            for key in sorted(stated)
            if key.endswith('-pip')
        ]
        ours = {key for key in stated if (ROOT / 'src' / key).is_dir()} - seen
        waiting += ours
        seen |= ours
        if name not in ROBOT:
            continue
        files = [*(folder / name).rglob('*.py'), *folder.glob('launch/*.py')]
        faults += [
            f'src/{name} imports {module}, which only pip installs: {REMEDY}'
            for module in sorted(imports_of(files, {name}) & only_pip)
        ]
        optional = OPTIONAL.get(name, set())
        faults += [
            f'src/{name} imports {module}, which is optional: import it where it is used'
            for module in sorted(imports_of(files, {name}, on_import=True) & optional)
        ]
    return faults


def check_wheel(folders: Iterable[Path]) -> list[str]:
    """Return an error message for each contradiction between packages and files for pip."""
    listed = set(read_requirements('packages.txt'))
    required = set().union(*(requirements_of(folder / 'setup.py') for folder in folders))
    needed = {name_of(line) for line in required} - {'setuptools'}
    pyproject = (ROOT / 'pyproject.toml').read_text('utf-8')
    faults = [f'requirements/packages.txt lacks {name}' for name in sorted(needed - listed)]
    faults += [f'requirements/packages.txt: {name} is unused' for name in sorted(listed - needed)]
    for folder in folders:
        if f'"src/{folder.name}"' not in pyproject:
            faults.append(f'pyproject.toml does not list src/{folder.name} in its packages')
        (version,) = keys_of(folder / 'package.xml', 'version')
        if f'\nversion = "{version}"\n' not in pyproject:
            faults.append(f'versions of src/{folder.name} ({version}) and pyproject.toml differ')
    return faults


def _keys(modules: set[str]) -> set[str]:
    keys = {LIBRARIES[m].key if m in LIBRARIES else m for m in modules}
    return keys - {''}


def _pypi(modules: set[str]) -> set[str]:
    return {LIBRARIES[m].distribution for m in modules if m in LIBRARIES}


def main() -> int:
    folders = sorted(p.parent for p in (ROOT / 'src').glob('*/setup.py'))
    faults = [fault for folder in folders for fault in check_package(folder)]
    faults += check_bounds(f for f in folders if f.name not in NOT_INSTALLED_BY_PIP)
    faults += check_wheel([f for f in folders if f.name not in NOT_INSTALLED_BY_PIP])
    faults += check_robot()
    for fault in faults:
        print(fault)
    return 1 if faults else 0


if __name__ == '__main__':
    sys.exit(main())
