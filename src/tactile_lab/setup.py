# Copyright 2026 Tendon Tactile maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

from setuptools import find_packages, setup

package_name = 'tactile_lab'

setup(
    name=package_name,
    version='0.1.0',
    packages=find_packages(exclude=['test*']),
    package_data={package_name: ['py.typed', 'report/page.html', 'watch/page/*']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{package_name}']),
        (f'share/{package_name}', ['package.xml']),
    ],
    install_requires=[
        'setuptools',
        'aiohttp',
        'joblib',
        'matplotlib',
        'numpy',
        'pyserial',
        'PyYAML',
        'dynamixel-sdk',
        'rich',
        'rosbags',
        'scipy',
        'typer',
    ],
    extras_require={'cluster': ['dask[distributed]'], 'tables': ['pyarrow'], 'test': ['pytest']},
    zip_safe=True,
    maintainer='Tendon Tactile maintainers',
    maintainer_email='maintainers@tendon-tactile.example.org',
    description='The tactile command: simulation, training, evaluation, reports, trials.',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'tactile = tactile_lab.cli.program:main',
        ],
    },
)
