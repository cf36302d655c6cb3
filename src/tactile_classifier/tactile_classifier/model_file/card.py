# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The card of a model: what it is, how good it was on held-out trials, and its limits."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from tactile_classifier.errors import ModelFileError
from tactile_classifier.model_file.manifest import Manifest
from tactile_classifier.names import CLASSIFIER_TITLES, describe_features, SCALING_TITLES
from tactile_classifier.records import PROBABILITY

MAX_LINE = 500
"""Characters of a line; the rest is cut off."""

MAX_LABELS = 40
"""Labels that are listed; the others are counted."""


def render_card(manifest: Manifest) -> str:
    """Return the card as text for people, in Markdown.

    Raises
    ------
    ModelFileError
        When an entry of the manifest is damaged.
    """
    facts = (f'- {name}: {value}' for name, value in describe_model(manifest).items())
    limits = (f'- {sentence}' for sentence in list_limits(manifest))
    lines = ('# Model card', '', *facts, '', '## Limits', '', *limits)
    return '\n'.join(map(_clean, lines)) + '\n'


def describe_model(manifest: Manifest) -> dict[str, str]:
    """Return the facts of the card by name.

    Raises
    ------
    ModelFileError
        When an entry of the manifest is damaged.
    """
    try:
        return _describe(manifest)
    except (AttributeError, KeyError, TypeError, ValueError, OverflowError) as error:
        raise ModelFileError(f'its manifest has a damaged entry: {error!r}') from error


def _describe(manifest: Manifest) -> dict[str, str]:
    whole, *partial = manifest.stages
    score, calibration, spec = manifest.cross_validation, manifest.calibration, manifest.spec
    more = len(manifest.labels) - MAX_LABELS
    labels = ', '.join(manifest.labels[:MAX_LABELS]) + f' and {more} more' * (more > 0)
    facts = {
        'answers': f'{manifest.task}, {manifest.contact or "any contact"}: {labels}',
        'classifier': f'{CLASSIFIER_TITLES[manifest.classifier]}, '
        f'{SCALING_TITLES[manifest.scaling]}',
        'takes': f'{len(spec.names)} {describe_features(spec)}, from '
        + (f'{spec.sample_count} samples' if spec.sample_count else 'windows of any length')
        + f' at {spec.rate_hz:g} Hz',
        'trained on': f'{manifest.trials} {_tell_origin(manifest)} trials, '
        f'{_tell_conditions(manifest)}; {manifest.created}',
        'cross-validation': f'{100 * score["mean"]:.1f} % ± {100 * score["spread"]:.1f} over '
        f'{score["spread_of"]} ({score["split"]})'
        if score
        else 'not stated',
        'chosen': _tell_choice(score.get('choice')),
        'held out': f'{100 * whole.accuracy:.1f} % named correctly ({calibration["split"]})'
        if whole.accuracy >= 0.0 and 'split' in calibration
        else f'not calibrated: {calibration.get("reason", "not stated")}',
        'scores': tell_scores(manifest),
    }
    before, after = whole.calibration_error_before, whole.calibration_error_after
    if after >= 0.0:
        facts['calibration error'] = (
            f'{100 * before:.1f} % before, {100 * after:.1f} % after, on held-out trials'
        )
    if whole.novelty_threshold >= 0.0:
        facts['unknown'] = (
            f'above novelty {whole.novelty_threshold:.2f}, at '
            f'{100 * manifest.false_alarm_rate:g} % false rejection'
        )
        if 'unlearned' in calibration:
            without = calibration['unlearned']
            facts['unlearned labels'] = (
                f'{100 * without["miss_rate"]:.0f} % of their trials get a known name: each of '
                f'{without["labels"]} labels left out in turn'
            )
    if partial:
        facts['early predictions'] = ', '.join(
            f'{stage.sample_count / spec.rate_hz:g} s {100 * stage.accuracy:.1f} %'
            for stage in partial
        )
    if 'recalibrated' in calibration:
        again = calibration['recalibrated']
        facts['recalibrated'] = (
            f'for one session, with {again["trials"]} known trials; from model {again["model_id"]}'
        )
    facts['made with'] = ', '.join(f'{name} {v}' for name, v in sorted(manifest.versions.items()))
    return facts


def _tell_choice(choice: Mapping[str, Any] | None) -> str:
    """Return how features and classifier were chosen, and the runner-up with its cost."""
    if choice is None:
        return 'features and classifier as stated, not by the folds'
    text = (
        f'from {choice["candidates"]} sets of features with classifiers; such a choice names '
        f'{100 * choice["accuracy"]:.1f} % correctly ({choice["split"]})'
    )
    other = choice.get('runner_up')
    if other is None:
        return text
    title = CLASSIFIER_TITLES[other['classifier']]
    return (
        f'{text}; runner-up: {other["feature_set"]}, {title}, '
        f'{100 * other["difference"]:+.1f} points, {other["time_ratio"]:.2g} times the time'
    )


def tell_scores(manifest: Manifest) -> str:
    """Return what the scores of a model are, and why raw ones were kept."""
    if manifest.score_kind == PROBABILITY:
        return 'calibrated probabilities'
    choice = manifest.calibration.get('scores')
    if choice is None:
        return f'raw ({manifest.score_kind}), not calibrated'
    return (
        f'raw ({manifest.score_kind}) are kept, because calibration was worse in both held-out '
        f'sessions (log loss {choice["log_loss_calibrated"]:.2f} calibrated, '
        f'{choice["log_loss_raw"]:.2f} raw)'
    )


def list_limits(manifest: Manifest) -> list[str]:
    """Return what the model was not tested on, in sentences."""
    training, calibration = manifest.training, manifest.calibration
    limits = []
    if manifest.simulated:
        limits.append('SIMULATED trials say nothing of a real finger.')
    limits.append(_tell_sessions(manifest))
    if training.mountings == 1:
        limits.append('All trials are of one mounting: another mounting was not tested.')
    elif training.mountings == 0:
        limits.append('The trials name no mounting: another mounting was not tested.')
    if training.speeds == 1:
        limits.append(
            f'All glides were at {1e3 * training.slowest_m_s:g} mm/s: another sliding speed was '
            'not tested.'
        )
    elif manifest.task == 'texture' and training.speeds < 1:
        limits.append('The trials state no sliding speed: another speed was not tested.')
    limits.append(
        'Specimens of one label were not told apart: another plate or object of that name was '
        'not tested.'
    )
    if manifest.stages[0].novelty_threshold >= 0.0:
        limits.append('An unknown object that feels like a known one is given its name.')
    else:
        limits.append('It never answers "unknown": every object is given a name.')
    if manifest.score_kind != PROBABILITY:
        limits.append('Its scores are no probabilities.')
    if 'recalibrated' in calibration:
        limits.append('It is recalibrated for one session. Take the original for another.')
    return limits


def _tell_sessions(manifest: Manifest) -> str:
    calibration = manifest.calibration
    share, groups = calibration.get('session_share', -1.0), calibration.get('groups', 0)
    if isinstance(share, float) and share > 0.0:
        holds = (
            'was shifted by the known trials of one session'
            if 'recalibrated' in calibration
            else f'holds in {100 * share:.0f} % of new sessions like these'
        )
        return (
            f'{groups} sessions were held out in turn. The threshold for unknown objects {holds}.'
        )
    if 'reason' in calibration:
        return f'No session was held out: {calibration["reason"]}. A new session may do worse.'
    if manifest.training.sessions > 1:
        return (
            'No session was held out: the trials do not allow it, because a label occurs in one '
            'session only. A new session may do worse.'
        )
    return 'No session was held out: a new session may do worse.'


def _tell_origin(manifest: Manifest) -> str:
    count = manifest.training.simulated
    if not manifest.simulated:
        return 'measured'
    return 'SIMULATED' if count == manifest.trials else f'({count} SIMULATED)'


def _tell_conditions(manifest: Manifest) -> str:
    training = manifest.training
    parts = [
        f'{number} {what}{"s" * (number != 1)}' if number > 0 else f'no {what} named'
        for number, what in ((training.sessions, 'session'), (training.mountings, 'mounting'))
    ]
    if training.speeds == 1:
        parts.append(f'{1e3 * training.slowest_m_s:g} mm/s')
    elif training.speeds > 1:
        slow, fast = 1e3 * training.slowest_m_s, 1e3 * training.fastest_m_s
        parts.append(f'{training.speeds} sliding speeds from {slow:g} to {fast:g} mm/s')
    return ', '.join(parts)


def _clean(line: str) -> str:
    """Return a line without what a terminal would obey, and not too long."""
    text = ''.join(c if c.isprintable() else '?' for c in line)
    return text if len(text) <= MAX_LINE else text[: MAX_LINE - 3] + '...'
