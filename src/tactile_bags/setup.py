# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

from setuptools import find_packages, setup

package_name = 'tactile_bags'

setup(
    name=package_name,
    version='0.1.0',
    packages=find_packages(exclude=['test*']),
    package_data={package_name: ['py.typed']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{package_name}']),
        (f'share/{package_name}', ['package.xml']),
    ],
    install_requires=[
        'setuptools',
        'lz4>=4.0',
        'mcap',
        'numpy>=1.26',
        'PyYAML>=6.0',
        'rosbags',
        'zstandard',
    ],
    extras_require={'test': ['pytest']},
    zip_safe=True,
    maintainer='Tendon Tactile maintainers',
    description='Bags of tactile recordings: read, write, record, play, audit, repair and replay.',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'bag_recorder_node = tactile_ros.node_program:main',
            'bag_player_node = tactile_ros.node_program:main',
        ],
        'tactile.nodes': [
            'bag_recorder_node = tactile_bags.nodes.bag_recorder_node:BagRecorderNode',
            'bag_player_node = tactile_bags.nodes.bag_player_node:BagPlayerNode',
        ],
    },
)
