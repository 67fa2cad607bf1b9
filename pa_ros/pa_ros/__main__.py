"""`python -m pa_ros` is the `pa_ros` command."""

import sys

if not sys.flags.safe_path:
    del sys.path[0]  # the current folder, whose random.py would stand in for Python's

from pa_ros.cli.main import main  # noqa: E402

sys.exit(main())
