# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

from glob import glob

from setuptools import find_packages, setup

package_name = 'tactile_bringup'

setup(
    name=package_name,
    version='0.1.0',
    packages=find_packages(exclude=['test*']),
    package_data={package_name: ['py.typed']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{package_name}']),
        (f'share/{package_name}', ['package.xml']),
        (f'share/{package_name}/launch', sorted(glob('launch/*.launch.py'))),
        (f'share/{package_name}/config', sorted(glob('config/*.yaml'))),
        (f'share/{package_name}/layouts', sorted(glob('layouts/*'))),
        (f'share/{package_name}/udev', sorted(glob('udev/*.rules'))),
        (f'share/{package_name}/urdf', sorted(glob('urdf/*.xacro'))),
        (f'share/{package_name}/systemd', sorted(glob('systemd/*.service'))),
    ],
    install_requires=[
        'PyYAML>=6.0',
        'setuptools',
    ],
    extras_require={'test': ['pytest']},
    zip_safe=True,
    maintainer='Tendon Tactile maintainers',
    description='Launch files, the graph of nodes, and the trial runner.',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'finger_node = tactile_bringup.nodes.finger_node:main',
            'trial_runner_node = tactile_ros.node_program:main',
        ],
        'tactile.nodes': [
            'trial_runner_node = tactile_bringup.nodes.trial_runner_node:TrialRunnerNode',
        ],
    },
)
