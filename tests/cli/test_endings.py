"""How commands end for which there is no memory."""

import pytest

from savmap.cli import endings
from savmap.errors import ModelError


@pytest.mark.parametrize("why", [MemoryError(), RuntimeError("std::bad_alloc"), OSError(12, "Cannot allocate memory")])
def test_no_memory_is_one_line_that_says_so(capsys: pytest.CaptureFixture[str], why: Exception) -> None:
    with pytest.raises(SystemExit) as caught, endings.plain_endings():
        raise ModelError("a.onnx: cannot be run") from why
    assert caught.value.code == 1
    assert capsys.readouterr().err.startswith("savmap: no memory is left (a.onnx: cannot be run): end other programs")
    with pytest.raises(SystemExit), endings.plain_endings():
        raise why
    assert capsys.readouterr().err.startswith("savmap: no memory is left (")
