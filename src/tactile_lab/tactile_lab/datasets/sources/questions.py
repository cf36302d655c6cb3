# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Questions about facts that a recording does not state: asked on a terminal, or refused."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from tactile_ros.errors import TactileError

LAYOUT = """recordings can be, all with their sample rate or with times:
  R1/01.csv, R1/02.csv, C1/01.csv ...   a file a trial, in folders named as the label
  one CSV or Parquet table              columns trial, label, time_s, and one a channel
  x.npy and x_labels.npy, or one .npz   numbers (trials, samples), and one label a trial
  R1/bag_1, C1/bag_2 ...                a bag a trial, with --topic and --field
  bags of this package                  with strain and trial events"""


class SourceError(TactileError):
    """A recording cannot be taken as labelled trials; says what to do."""


@dataclass
class Questions:
    """Decides where a recording does not say something, and keeps what was decided.

    Attributes
    ----------
    ask : callable or None
        ``ask(question, choices, guess)`` returns an answer; None: nobody can be asked.
    accepts_guesses : bool
        Take the guess where there is one, without asking.
    notes : list of str
        What was taken for what, in words.
    """

    ask: Callable[[str, Sequence[str], str], str] | None = None
    accepts_guesses: bool = False
    notes: list[str] = field(default_factory=list)

    def note(self, sentence: str) -> None:
        """Keep a sentence, once."""
        if sentence not in self.notes:
            self.notes.append(sentence)

    def choose(
        self,
        question: str,
        choices: Sequence[str],
        option: str,
        guess: str = '',
        *,
        with_layout: bool = True,
    ) -> str:
        """Return the answer to a question.

        Parameters
        ----------
        question : str
            What is not known, as a sentence without its end.
        choices : sequence of str
            What it may be.
        option : str
            How the command line says it, with its value.
        guess : str
            The likely answer; empty: there is none.
        with_layout : bool
            Whether `LAYOUT` follows a refusal.

        Raises
        ------
        SourceError
            When nobody can be asked, and there is no guess or guesses are not accepted.
        """
        if guess and self.accepts_guesses:
            return guess
        if self.ask is not None:
            return self.ask(question, choices, guess)
        offered = f': {", ".join(choices[:12])}' if choices else ''
        likely = f'; --yes takes {guess}' if guess else ''
        layout = f'\n{LAYOUT}' if with_layout else ''
        raise SourceError(f'{question}{offered}. State it with {option}{likely}{layout}')
