# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

from setuptools import find_packages, setup

package_name = 'tactile_lab'

setup(
    name=package_name,
    version='0.1.0',
    packages=find_packages(exclude=['test*']),
    package_data={package_name: ['py.typed', 'watch/page/*']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{package_name}']),
        (f'share/{package_name}', ['package.xml']),
    ],
    install_requires=[
        'setuptools',
        'aiohttp>=3.9',
        'Jinja2>=3.1',
        'joblib>=1.3',
        'numpy>=1.26',
        'pyarrow',
        'pyserial>=3.5',
        'PyYAML>=6.0',
        'dynamixel-sdk',
        'rich>=13.7',
        'rosbags',
        'scipy>=1.11',
        'typer>=0.9',
    ],
    extras_require={'test': ['pytest']},
    zip_safe=True,
    maintainer='Tendon Tactile maintainers',
    description='The tactile command: simulation, training, evaluation, reports, trials.',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'tactile = tactile_lab.__main__:main',
        ],
    },
)
