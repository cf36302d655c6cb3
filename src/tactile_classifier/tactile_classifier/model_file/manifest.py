# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Manifest of a model file, stored as JSON, and the model card as text."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
import dataclasses
import math
from typing import Any, get_origin, get_type_hints

from tactile_classifier.confidence.held_out_novelty import HeldOutNovelty, rank_of_sessions
from tactile_classifier.coverage import format_coverage
from tactile_classifier.datasets.dataset import plain_name
from tactile_classifier.errors import ModelFileError, refuse_damage
from tactile_classifier.types import (
    ALL_CLASSIFIERS,
    CLASSIFIER_TITLES,
    MARGIN,
    NO_ANSWER,
    PROBABILITY,
    SCALING_TITLES,
    SCALINGS,
    UNKNOWN,
    VOTES,
)
from tactile_features.feature_sets.registry import find_feature_set
from tactile_features.model_contract import (
    check_version,
    DIGEST,
    FORMAT_VERSION,
    parse_spec,
)
from tactile_features.spec import FeatureSpec
from tactile_ros.errors import plain_text

KNOWN_NOVELTY = 'held_out_novelty'
"""Entry of ``calibration`` in a manifest that contains the novelties of held-out trials."""


@dataclasses.dataclass(frozen=True)
class Confidence:
    """Calibration and novelty threshold of a model.

    A window whose novelty exceeds ``novelty_threshold`` [1] is "unknown"; the threshold is
    negative if the model has none. ``slope`` and ``offset`` are the parameters of `Calibration`;
    they are negative if scores are raw. The expected calibration errors and the accuracy are
    measured on held-out trials [1]; they are negative if the model is not calibrated.
    """

    novelty_threshold: float = -1.0
    slope: float = -1.0
    offset: float = -1.0
    calibration_error_before: float = -1.0
    calibration_error_after: float = -1.0
    accuracy: float = -1.0


@dataclasses.dataclass(frozen=True)
class TrainingTrials:
    """Conditions under which the training trials were recorded.

    The fields are the numbers of sessions, mountings and speeds (0 if not recorded), the range of
    sliding speeds [m/s] (negative if not recorded), and the number of simulated trials.
    """

    sessions: int = 0
    mountings: int = 0
    speeds: int = 0
    slowest_m_s: float = -1.0
    fastest_m_s: float = -1.0
    simulated: int = 0


@dataclasses.dataclass(frozen=True)
class Manifest:
    """Description of a model: labels, features, training trials and accuracy.

    Attributes
    ----------
    contact : str
        Flexion or abduction; empty if the training trials contain both, or their contact is
        unknown.
    spec : FeatureSpec
        Specification of the features.
    labels : tuple of str
        Labels, in the order of the scores.
    score_kind : str
        See Classification.msg.
    simulated : bool
        True if any training trial was simulated.
    training_sha256 : str
        Digest of the training table; see `FeatureTable.compute_sha256`.
    trials : int
        Number of training trials.
    trial_digests : tuple of str
        Digests of the training trials in any order; see `FeatureTable.digest_trials`.
    versions : mapping of str to str
        Versions of the libraries that trained the model.
    cross_validation : mapping
        ``mean``, ``spread``, ``spread_of``, ``split`` and ``interval``; empty if not evaluated.
        If features and classifier were chosen automatically, ``choice`` describes the choice
        (`FeatureChoice.summarise`), and the other entries describe its nested score.
    created : str
        Time of training (ISO 8601, UTC).
    confidence : Confidence
    calibration : mapping
        The held-out trials that were used for the threshold and the probabilities: ``split``,
        ``groups``, ``trials`` and ``held_out`` (the columns that define a group). ``strict`` is
        true for the strict threshold. If there is no calibration, ``reason`` states why.
        ``held_out_novelty`` contains the novelties of held-out trials of each group
        (`HeldOutNovelty`). ``surplus`` is the stated probability minus the accuracy, over the
        groups (`Surplus`). ``unlearned`` is the rejection of labels that were left out of the
        training (`UnlearnedLabels`).
    false_alarm_rate : float
        Fraction of windows of known labels that the threshold may reject [1]; negative if there is
        no threshold.
    parameters : mapping
        Parameters of the classifier, such as ``C``, that differ from the defaults of
        ``tactile train``.
    """

    task: str
    contact: str
    spec: FeatureSpec
    labels: tuple[str, ...]
    score_kind: str
    classifier: str
    scaling: str
    simulated: bool
    training_sha256: str
    trials: int
    trial_digests: tuple[str, ...]
    versions: Mapping[str, str]
    cross_validation: Mapping[str, Any]
    created: str
    confidence: Confidence = Confidence()
    calibration: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    false_alarm_rate: float = -1.0
    training: TrainingTrials = TrainingTrials()
    parameters: Mapping[str, Any] = dataclasses.field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """Return the manifest as a dictionary for JSON."""
        fields = {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}
        fields['spec'] = self.spec.to_dict()
        fields['labels'] = list(self.labels)
        fields['trial_digests'] = list(self.trial_digests)
        fields['confidence'] = dataclasses.asdict(self.confidence)
        fields['training'] = dataclasses.asdict(self.training)
        return {'format_version': FORMAT_VERSION, DIGEST: self.spec.digest, **fields}

    @classmethod
    def from_dict(cls, entries: Mapping[str, Any]) -> Manifest:
        """Return a manifest from the dictionary that `to_dict` returned.

        Raises ModelFileError if an entry is missing, invalid or unknown.
        """
        fields = check_version(entries)
        spec = parse_spec(fields)
        del fields[DIGEST]
        _check_fields(cls, fields)
        if fields['false_alarm_rate'] > 1.0:
            raise ModelFileError('its manifest has a false alarm rate that is not between 0 and 1')
        for name, kind in (('confidence', Confidence), ('training', TrainingTrials)):
            _check_fields(kind, fields[name], f' in "{name}"')
            fields[name] = kind(**fields[name])
        for name in ('labels', 'trial_digests'):
            if not all(type(text) is str for text in fields[name]):
                raise ModelFileError(f'its manifest has no valid entry "{name}"')
            fields[name] = tuple(fields[name])
        manifest = cls(**{**fields, 'spec': spec})
        manifest._check()
        return manifest

    def _check(self) -> None:
        if len(self.labels) < 2 or len(set(self.labels)) < len(self.labels) or '' in self.labels:
            raise ModelFileError('its labels must be two or more different names')
        refuse_reserved(self.labels)
        for name, value, choices in (
            ('score_kind', self.score_kind, (VOTES, MARGIN, PROBABILITY)),
            ('classifier', self.classifier, ALL_CLASSIFIERS),
            ('scaling', self.scaling, SCALINGS),
        ):
            if value not in choices:
                raise ModelFileError(
                    f'its {name} is "{value}"; it must be one of {", ".join(choices)}'
                )


def refuse_reserved(labels: Iterable[str]) -> None:
    """Raise ModelFileError if a label is the name of a result without a label."""
    if taken := sorted({UNKNOWN, NO_ANSWER}.intersection(labels)):
        raise ModelFileError(
            f'the label "{taken[0]}" is reserved for windows without a label: rename it'
        )


_IN_JSON = {tuple: list, Mapping: dict, FeatureSpec: dict, TrainingTrials: dict, Confidence: dict}


def _check_fields(kind: type, entries: Mapping[str, Any], where: str = '') -> None:
    """Check that entries have the fields and types of a dataclass.

    Numbers must be finite and at least -1. ``where`` is added to the message of an error.
    """
    types = get_type_hints(kind)
    for name, expected in types.items():
        value = entries.get(name)
        is_allowed = not isinstance(value, int | float) or -1 <= value < math.inf
        is_of_type = type(value) is _IN_JSON.get(get_origin(expected) or expected, expected)
        if not (is_of_type and is_allowed):
            raise ModelFileError(f'its manifest has no valid entry "{name}"{where}')
    if unknown := sorted(set(entries) - set(types)):
        raise ModelFileError(f'its manifest has the unknown entry "{unknown[0]}"{where}')


MAX_LINE = 500
"""Maximum length of a line in characters; longer lines are truncated."""

MAX_LABELS = 40
"""Maximum number of labels that are listed; further labels are only counted."""


KNN_TIES = 'broken in favour of the earlier trial'


def format_card(manifest: Manifest) -> str:
    """Return the model card in Markdown; raises the same errors as `list_facts`."""
    facts = (f'- {name}: {value}' for name, value in list_facts(manifest).items())
    limits = (f'- {sentence}' for sentence in list_limits(manifest))
    lines = ('# Model card', '', *facts, '', '## Limits', '', *limits)
    return '\n'.join(map(_clean, lines)) + '\n'


def format_features(spec: FeatureSpec) -> str:
    """Return a text with the name of the feature set and its options."""
    found = find_feature_set(spec.feature_set)
    options = [name for name in (found.options if found else ()) if name in spec.parameters]
    stated = [f'{name} {spec.parameters[name]}' for name in options]
    return f'features: {", ".join([spec.feature_set, *stated])}'


@refuse_damage('an entry of its manifest is')
def list_facts(manifest: Manifest) -> dict[str, str]:
    """Return the facts of the card by name; raise ModelFileError if an entry is damaged."""
    confidence = manifest.confidence
    score, calibration, spec = manifest.cross_validation, manifest.calibration, manifest.spec
    more = len(manifest.labels) - MAX_LABELS
    labels = ', '.join(manifest.labels[:MAX_LABELS]) + f' and {more} more' * (more > 0)
    facts = {
        'answers': f'{manifest.task}, {manifest.contact or "any contact"}: {labels}',
        'classifier': ', '.join(
            [
                CLASSIFIER_TITLES[manifest.classifier],
                *(f'{name} {value}' for name, value in manifest.parameters.items()),
                SCALING_TITLES[manifest.scaling],
            ]
        ),
        **({'ties': KNN_TIES} if manifest.classifier == 'knn' else {}),
        'takes': f'{len(spec.names)} {format_features(spec)}, from '
        + ('the first ' if spec.is_early else '')
        + (f'{spec.sample_count} samples' if spec.sample_count else 'windows of any length')
        + f' at {spec.rate_hz:g} Hz',
        **({'channel': spec.describe_channel()} if spec.channel else {}),
        'trained on': f'{manifest.trials} {_format_origin(manifest)} trials, '
        f'{_format_conditions(manifest)}; {manifest.created}',
        'accuracy': _format_accuracy(manifest),
        'chosen': _format_choice(score.get('choice')),
        'scores': format_scores(manifest),
    }
    before, after = confidence.calibration_error_before, confidence.calibration_error_after
    if after >= 0.0:
        facts['calibration error'] = (
            f'{100 * before:.1f} % before, {100 * after:.1f} % after, on held-out trials'
        )
        if 'surplus' in calibration:
            facts['stated probability minus accuracy'] = (
                f'{_format_surplus(calibration)} points (95 %, over {format_groups(calibration)})'
            )
    facts |= describe_thresholds(manifest)
    facts['made with'] = ', '.join(f'{name} {v}' for name, v in sorted(manifest.versions.items()))
    return facts


def read_known_novelty(manifest: Manifest) -> HeldOutNovelty | None:
    """Return the novelties of held-out trials; None if the model has no novelty measure.

    Raises ModelFileError if the entry is missing or damaged.
    """
    if manifest.confidence.novelty_threshold < 0.0:
        return None
    return HeldOutNovelty.read(manifest.calibration.get(KNOWN_NOVELTY))


MAX_SESSIONS = 12
"""Maximum number of sessions that are listed; further sessions are only counted."""


@refuse_damage('an entry of its manifest is')
def describe_thresholds(manifest: Manifest) -> dict[str, str]:
    """Describe the false rejection by the default and by the strict threshold.

    The false rejection rate of a session is measured with a threshold that is computed from the
    other sessions.
    """
    threshold, calibration = manifest.confidence.novelty_threshold, manifest.calibration
    known = read_known_novelty(manifest)
    if known is None:
        return {}
    is_strict = calibration.get('strict') is True
    things, rate = format_groups(calibration), manifest.false_alarm_rate
    scope = ''
    if known.names:
        scope = f' in most new {things}' if is_strict else f' on average over {things}'
    facts = {
        'unknown': f'above novelty {threshold:.2f}, for {100 * rate:g} % false rejection{scope}'
    }
    if rate > 0.0:
        for strict, name in ((False, 'mean'), (True, 'strict')):
            shares = known.reject_sessions(rate, strict=strict)
            if shares:
                facts[f'false rejection, {name} threshold'] = (
                    f'{_format_shares(shares, known.names)} ({things} held out; above novelty '
                    f'{known.compute_threshold(rate, strict=strict):.2f})'
                )
    if 'unlearned' in calibration:
        without = calibration['unlearned']
        facts['unlearned labels'] = (
            f'{100 * without["miss_rate"]:.0f} % of their trials receive a known label with the '
            f'mean threshold, {100 * without["strict_miss_rate"]:.0f} % with the strict threshold '
            f'(each of {without["labels"]} labels left out once)'
        )
    return facts


def _format_shares(shares: Sequence[float], names: Sequence[str]) -> str:
    """Return the mean of the rates, the largest rate, and each rate with its name."""
    worst = max(range(len(shares)), key=lambda i: shares[i])
    listed = ', '.join(
        f'{name} {100 * share:.0f}'
        for name, share in list(zip(names, shares, strict=True))[:MAX_SESSIONS]
    )
    more = len(shares) - MAX_SESSIONS
    return (
        f'{100 * sum(shares) / len(shares):.1f} % on average, at most '
        f'{100 * shares[worst]:.0f} % ({names[worst]}); {listed}'
        + f' and {more} more'
        * (more > 0)
    )


def _format_accuracy(manifest: Manifest) -> str:
    """Return the accuracy for the card.

    This is the cross-validated accuracy; it is nested if the classifier was chosen inside the
    folds. If there was no cross-validation, it is the accuracy on the held-out trials of the
    calibration.
    """
    score, calibration = manifest.cross_validation, manifest.calibration
    if score:
        is_chosen = 'choice' in score
        inside = ', chosen inside the folds' if is_chosen else ''
        interval = score['interval']
        coverage = format_coverage(score.get('spread_of', ''), [score['mean']], chosen=is_chosen)
        span = (
            f'no interval: {interval["reason"]}'
            if 'reason' in interval
            else f'95 % interval {100 * interval["low"]:.1f} to {100 * interval["high"]:.1f} %'
            f'{coverage}'
        )
        return f'{100 * score["mean"]:.1f} % ({score["split"]}{inside}; {span})'
    if manifest.confidence.accuracy >= 0.0 and 'split' in calibration:
        return f'{100 * manifest.confidence.accuracy:.1f} % ({calibration["split"]})'
    return f'not known: {calibration.get("reason", "not stated")}'


def _format_choice(choice: Mapping[str, Any] | None) -> str:
    """Describe the choice of features and classifier, and the runner-up with its cost."""
    if choice is None:
        return 'features and classifier as given, not chosen automatically'
    text = f'from {choice["candidates"]} combinations of features and classifier'
    if choice.get('has_few_groups'):
        text += (
            f'; {choice["groups"]} groups are too few for a choice by accuracy, so the most '
            'robust combination is preferred: record more groups'
        )
    other = choice.get('runner_up')
    if other is None:
        return text
    title = CLASSIFIER_TITLES[other['classifier']]
    return (
        f'{text}; runner-up: {other["feature_set"]}, {title}, '
        f'{100 * other["difference"]:+.1f} points, {format_time_ratio(other["time_ratio"])}'
    )


def format_time_ratio(ratio: float) -> str:
    """Return a ratio of computing times in words, such as "230 times slower"."""
    if not ratio > 0.0:
        return 'time not measured'
    factor = max(ratio, 1.0 / ratio)
    if factor < 1.1:
        return 'equally fast'
    return f'{factor:.{0 if factor >= 10 else 1}f} times {"slower" if ratio > 1.0 else "faster"}'


def format_scores(manifest: Manifest) -> str:
    """Describe the scores of a model."""
    if manifest.score_kind == PROBABILITY:
        return 'calibrated probabilities'
    return f'raw ({manifest.score_kind}), not calibrated'


def list_limits(manifest: Manifest) -> list[str]:
    """Return the limits of the evaluation, one sentence each."""
    training = manifest.training
    limits = []
    if manifest.simulated:
        limits.append('SIMULATED trials do not predict the accuracy with a real finger.')
    limits.append(_format_sessions(manifest))
    if training.mountings == 1:
        limits.append('All trials have the same mounting: other mountings were not tested.')
    elif training.mountings == 0:
        limits.append('The mountings are not recorded: other mountings were not tested.')
    if training.speeds == 1:
        limits.append(
            f'All glides were at {1e3 * training.slowest_m_s:g} mm/s: other sliding speeds were '
            'not tested.'
        )
    elif manifest.task == 'texture' and training.speeds < 1:
        limits.append('The sliding speeds are not recorded: other speeds were not tested.')
    limits.append(
        'Specimens of the same label are not distinguished: other plates or objects with the same '
        'label were not tested.'
    )
    if manifest.confidence.novelty_threshold >= 0.0:
        limits.append('An unknown object that feels like a known object receives its label.')
    else:
        limits.append('Without a threshold for "unknown", every object receives a known label.')
    if manifest.score_kind != PROBABILITY:
        limits.append('The scores are not probabilities.')
    else:
        limits += warn_of_few_groups(manifest)
    return limits


FEWEST_GROUPS = 5
"""If there are fewer held-out groups, the card warns that the probabilities are uncertain."""

WIDEST_SURPLUS = 0.1
"""If the half-width of the interval of `Surplus` is larger than this, the card warns [1]."""


@refuse_damage('an entry of its manifest is')
def warn_of_few_groups(manifest: Manifest) -> list[str]:
    """Return a warning if there are too few groups to assess the probabilities."""
    calibration = manifest.calibration
    things = format_groups(calibration)
    if 'surplus' not in calibration:
        return [
            f'WARNING: several held-out {things} are needed to assess the probabilities. '
            f'Record more {things}.'
        ]
    groups = int(calibration['groups'])
    if groups >= FEWEST_GROUPS and calibration['surplus']['half_width'] <= WIDEST_SURPLUS:
        return []
    return [
        f'WARNING: {groups} {things} are too few to assess the probabilities: they may be wrong '
        f'by {_format_surplus(calibration)} points. Record more {things}.'
    ]


def _format_surplus(calibration: Mapping[str, Any]) -> str:
    surplus = calibration['surplus']
    low, high = (
        min(max(100 * (surplus['mean'] + sign * surplus['half_width']), -100.0), 100.0)
        for sign in (-1, 1)
    )
    return f'{low:+.0f} to {high:+.0f}'


def format_groups(calibration: Mapping[str, Any]) -> str:
    """Return the plural name of the held-out groups, such as "sessions"."""
    columns = calibration.get('held_out') or ['session_id']
    if columns == ['session_id']:
        return 'sessions'
    with refuse_damage('an entry of its manifest is'):
        return f'groups by {" and ".join(map(plain_name, columns))}'


def _format_sessions(manifest: Manifest) -> str:
    calibration = manifest.calibration
    things = format_groups(calibration)
    groups = calibration.get('groups', 0)
    if isinstance(groups, int) and groups > 0:
        return f'Each of {groups} {things} was held out once. {describe_scope(manifest)}'
    why = ''
    if 'reason' in calibration:
        why = f': {calibration["reason"]}'
    elif things != 'sessions' or manifest.training.sessions > 1:
        why = ', because a label occurs in only one of them'
    return f'No {things} were held out{why}. Accuracy may be lower in new {things}.'


@refuse_damage('an entry of its manifest is')
def describe_scope(manifest: Manifest) -> str:
    """Return a sentence that states for which new sessions the novelty threshold holds."""
    calibration = manifest.calibration
    things, groups = format_groups(calibration), calibration.get('groups', 0)
    if not isinstance(groups, int) or groups < 1:
        return (
            'The threshold for unknown objects holds for trials of these sessions. No group was '
            'held out, so a new session may differ.'
        )
    if calibration.get('strict') is True:
        share = rank_of_sessions(groups) / (groups + 1)
        return (
            f'The threshold for unknown objects holds in {100 * share:.0f} % of new {things} like '
            'these.'
        )
    return (
        f'The threshold for unknown objects holds on average over new {things} like these; '
        'the false rejection rate of a single one may be higher.'
    )


def _format_origin(manifest: Manifest) -> str:
    count = manifest.training.simulated
    if not manifest.simulated:
        return 'measured'
    return 'SIMULATED' if count == manifest.trials else f'({count} SIMULATED)'


def _format_conditions(manifest: Manifest) -> str:
    training, calibration = manifest.training, manifest.calibration
    parts = [
        f'{number} {what}{"s" * (number != 1)}' if number > 0 else f'no {what} recorded'
        for number, what in ((training.sessions, 'session'), (training.mountings, 'mounting'))
    ]
    groups = calibration.get('groups', 0)
    if training.sessions == 0 and isinstance(groups, int) and groups > 0:
        parts[0] = f'{groups} {format_groups(calibration)}'
    if training.speeds == 1:
        parts.append(f'{1e3 * training.slowest_m_s:g} mm/s')
    elif training.speeds > 1:
        slow, fast = 1e3 * training.slowest_m_s, 1e3 * training.fastest_m_s
        parts.append(f'{training.speeds} sliding speeds from {slow:g} to {fast:g} mm/s')
    return ', '.join(parts)


def _clean(line: str) -> str:
    """Remove terminal control characters from a line, and truncate it."""
    text = plain_text(line)
    return text if len(text) <= MAX_LINE else text[: MAX_LINE - 3] + '...'
