# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

from setuptools import find_packages, setup

package_name = 'tactile_analysis'

setup(
    name=package_name,
    version='0.1.0',
    packages=find_packages(exclude=['test*']),
    package_data={package_name: ['py.typed', 'report/templates/*']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{package_name}']),
        (f'share/{package_name}', ['package.xml']),
    ],
    install_requires=[
        'setuptools',
        'Jinja2>=3.1',
        'matplotlib>=3.6',
        'numpy>=1.26',
        'pandas>=2.1',
        'pyarrow',
        'scipy>=1.11',
    ],
    extras_require={'test': ['pytest']},
    zip_safe=True,
    maintainer='Tendon Tactile maintainers',
    description='Analysis of recordings without ROS: import, features, accuracy, report.',
    license='Apache-2.0',
)
