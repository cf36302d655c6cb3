# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

from setuptools import find_packages, setup

package_name = 'tendon_sensor_driver'

setup(
    name=package_name,
    version='0.1.0',
    packages=find_packages(exclude=['test*']),
    package_data={package_name: ['py.typed']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{package_name}']),
        (f'share/{package_name}', ['package.xml']),
    ],
    install_requires=['setuptools', 'numpy>=1.26', 'pyserial>=3.5'],
    extras_require={'test': ['pytest']},
    zip_safe=True,
    maintainer='Tendon Tactile maintainers',
    description='Reads the force sensor on the tendon and publishes the tension as strain blocks.',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'tendon_sensor_node = tactile_ros.node_program:main',
        ],
        'tactile.nodes': [
            'tendon_sensor_node = tendon_sensor_driver.tendon_sensor_node:TendonSensorNode',
        ],
    },
)
