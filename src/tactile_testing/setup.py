# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

from setuptools import find_packages, setup

package_name = 'tactile_testing'

setup(
    name=package_name,
    version='0.1.0',
    packages=find_packages(exclude=['test*']),
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{package_name}']),
        (f'share/{package_name}', ['package.xml']),
    ],
    install_requires=['setuptools', 'hypothesis', 'numpy', 'pytest', 'pyserial'],
    extras_require={'test': ['pytest']},
    zip_safe=True,
    maintainer='Tendon Tactile maintainers',
    description='Helpers and fixtures that the tests of several packages share.',
    license='Apache-2.0',
)
