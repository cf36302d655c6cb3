# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

from setuptools import find_packages, setup

package_name = 'tactile_sim'

setup(
    name=package_name,
    version='0.1.0',
    packages=find_packages(exclude=['test*']),
    package_data={package_name: ['py.typed', 'config/*.yaml']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{package_name}']),
        (f'share/{package_name}', ['package.xml']),
    ],
    install_requires=['setuptools', 'numba>=0.58', 'numpy>=1.26'],
    extras_require={'test': ['pytest']},
    zip_safe=False,
    maintainer='Tendon Tactile maintainers',
    description='Simulation of the palpation rig, with devices that speak the real protocols.',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'tactile_sim_rig = tactile_sim.rig_server:main',
        ],
    },
)
