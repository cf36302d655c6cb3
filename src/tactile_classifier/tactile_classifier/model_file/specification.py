# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Whether a window's features are of the specification that a model was trained on."""

from __future__ import annotations

from tactile_features.records import FeatureWindow, Outcome
from tactile_features.spec import FeatureSpec


def describe_mismatch(
    window: FeatureWindow, trained: FeatureSpec, expected: FeatureSpec | None
) -> str:
    """Return why a window has features of another specification, or an empty string.

    What the message states is compared by itself and named with the parameter to set. Of the
    rest the digest alone tells that something differs; then the sentence names all of it.

    Parameters
    ----------
    window : FeatureWindow
    trained : FeatureSpec
        What the model was trained on.
    expected : FeatureSpec or None
        The same with all that a feature node's states; None: not known, the digest is not
        compared.
    """
    pairs = [
        ('feature set', window.feature_set, trained.feature_set, 'texture_features'),
        ('version of the feature set', window.feature_set_version, trained.version, ''),
        ('rate in Hz', window.rate_hz, trained.rate_hz, 'rate_hz'),
    ]
    if window.outcome == Outcome.OK:
        if trained.sample_count and not window.running:
            samples = (window.sample_count, trained.sample_count)
            pairs.append(('window in samples', *samples, 'texture_samples'))
        pairs.append(('number of features', len(window.values), len(trained.names), ''))
    for what, got, wanted, parameter in pairs:
        if got != wanted:
            remedy = f'set {parameter} of the feature node' if parameter else 'train it again'
            return f'the {what} is {got}; the model was trained on {wanted}: {remedy}'
    if expected is None or window.specification_digest == expected.digest:
        return ''
    if not window.specification_digest:
        return (
            'the features do not state the specification that made them: '
            "update the feature node to the classifier's release"
        )
    values = ', '.join(
        f'{name} {value if isinstance(value, str) else format(value, "g")}'
        for name, value in sorted(expected.parameters.items())
    )
    return (
        'the features were made by another specification than the model was trained on '
        f'(digest {window.specification_digest} instead of {expected.digest}): '
        f'set on the feature node {values}'
    )
