"""Fuzz programs and JSON descriptions, guided by coverage: `python tests/fuzz/guided.py [OPTIONS]`.

Atheris observes which branches a text takes and changes the text to reach others. The options are
libFuzzer's. Without atheris it prints a note and does nothing.
"""

from __future__ import annotations

import sys


def main() -> int:
    try:
        import atheris
    except ImportError:
        print("guided: atheris isn't installed here: nothing was run")
        return 0
    with atheris.instrument_imports():
        from pa_ros.arena import design_named
        from pa_ros.core.errors import PaError
        from pa_ros.language import parse
        from pa_ros.networks.config import actor_config
    words = design_named("2-L").vocabulary

    def look(content: bytes) -> None:
        given = atheris.FuzzedDataProvider(content)
        read = given.PickValueInList([actor_config, lambda text: parse(text, words)])
        try:
            read(given.ConsumeUnicode(4096))
        except PaError as error:
            assert error.code and str(error)

    atheris.Setup(sys.argv, look)
    atheris.Fuzz()
    return 0


if __name__ == "__main__":
    sys.exit(main())
