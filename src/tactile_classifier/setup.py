# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

from setuptools import find_packages, setup

package_name = 'tactile_classifier'

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
        'joblib>=1.3',
        'numba>=0.58',
        'numpy>=1.26',
        'scikit-learn>=1.4',
        'scipy>=1.11',
        'threadpoolctl',
    ],
    extras_require={'test': ['pytest']},
    zip_safe=True,
    maintainer='Tendon Tactile maintainers',
    description='Datasets, training, evaluation, the model file and the classifier node.',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'tactile_classifier_node = tactile_ros.node_program:main',
        ],
        'tactile.nodes': [
            'tactile_classifier_node = '
            'tactile_classifier.tactile_classifier_node:TactileClassifierNode',
        ],
    },
)
