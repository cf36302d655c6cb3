# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

from setuptools import find_packages, setup

package_name = 'tactile_features'

setup(
    name=package_name,
    version='0.1.0',
    packages=find_packages(exclude=['test*']),
    package_data={package_name: ['py.typed']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{package_name}']),
        (f'share/{package_name}', ['package.xml']),
    ],
    install_requires=['setuptools', 'numpy>=1.26', 'scikit-learn>=1.4'],
    extras_require={'test': ['pytest']},
    zip_safe=True,
    maintainer='Tendon Tactile maintainers',
    description=(
        'Cuts the tension stream into windows and computes texture and stiffness features.'
    ),
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'tactile_features_node = tactile_ros.node_program:main',
        ],
        'tactile.nodes': [
            'tactile_features_node = tactile_features.tactile_features_node:TactileFeaturesNode',
        ],
    },
)
