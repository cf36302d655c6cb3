# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

from setuptools import find_packages, setup

package_name = 'linear_guide_driver'

setup(
    name=package_name,
    version='0.1.0',
    packages=find_packages(exclude=['test*']),
    package_data={package_name: ['py.typed']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{package_name}']),
        (f'share/{package_name}', ['package.xml']),
    ],
    install_requires=['setuptools', 'dynamixel-sdk', 'numpy>=1.26', 'pyserial>=3.5'],
    extras_require={'test': ['pytest']},
    zip_safe=True,
    maintainer='Tendon Tactile maintainers',
    description='Moves the linear guide (Grbl) and the tendon actuator (Dynamixel) '
    'as ROS 2 actions.',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'linear_guide_node = tactile_ros.node_program:main',
            'tendon_actuator_node = tactile_ros.node_program:main',
        ],
        'tactile.nodes': [
            'linear_guide_node = linear_guide_driver.linear_guide_node:LinearGuideNode',
            'tendon_actuator_node = linear_guide_driver.tendon_actuator_node:TendonActuatorNode',
        ],
    },
)
