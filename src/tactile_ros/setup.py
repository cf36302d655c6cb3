# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

from setuptools import find_packages, setup

package_name = 'tactile_ros'

setup(
    name=package_name,
    version='0.1.0',
    packages=find_packages(exclude=['test*']),
    package_data={package_name: ['py.typed', 'loopback.xml']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{package_name}']),
        (f'share/{package_name}', ['package.xml']),
    ],
    install_requires=['setuptools', 'numpy>=1.26', 'PyYAML>=6.0'],
    extras_require={'test': ['pytest']},
    zip_safe=True,
    maintainer='Tendon Tactile maintainers',
    description='Base classes and helpers that all nodes share.',
    license='Apache-2.0',
)
