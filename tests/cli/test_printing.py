"""What a terminal shows of long work and long lines."""

from __future__ import annotations

import io

from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from bondgraph.cli.printing import for_terminal, say
from bondgraph.report.progress import WorkProgress


def test_finished_stages_leave_lines_on_a_terminal_and_nothing_elsewhere() -> None:
    terminal, file = io.StringIO(), io.StringIO()
    for stream, is_terminal in ((terminal, True), (file, False)):
        console = Console(file=stream, force_terminal=is_terminal, width=120)
        with WorkProgress("closing the loop", None, console=console) as work:
            for done in range(1, 4):
                work.stage("scores", done, 3)
            work.stage("refits", 1, 2)
    assert "0:00:00  scores, 3 steps in 0:00:00" in terminal.getvalue()
    assert "0:00:00  refits, 1 steps in 0:00:00" in terminal.getvalue()
    assert file.getvalue() == ""


@given(st.lists(st.text("abcdefg_", min_size=1, max_size=12), min_size=1, max_size=40), st.integers(20, 100))
def test_wrapping_keeps_words_and_the_width(words: list[str], width: int) -> None:
    lines = for_terminal(" ".join(words), width).split("\n")
    assert " ".join(lines).split() == words
    assert all(len(line) <= width for line in lines)


def test_programs_get_lines_as_they_are() -> None:
    stream, line = io.StringIO(), "not used: " + ", ".join(f"c{k}" for k in range(100))
    say(line, stream)
    assert stream.getvalue() == line + "\n"
