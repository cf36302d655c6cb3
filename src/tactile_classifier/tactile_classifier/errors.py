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

"""What can go wrong with data, evaluation and model files."""


class ClassifierError(Exception):
    """Root of the package's errors; the message is a sentence for the user."""


class DatasetError(ClassifierError):
    """The trials cannot be used as they are."""


class TooFewTrialsError(DatasetError, ValueError):
    """There are too few trials for what was asked; more recordings are the remedy.

    A `ValueError` too, which is what scikit-learn's callers expect of an estimator.
    """


class EvaluationError(ClassifierError):
    """The trials do not allow the split that was asked for."""


class ModelFileError(ClassifierError):
    """A model file cannot be written, is not one, or does not fit."""
