"""`python -m pa_ros` is the `pa_ros` command."""

import sys

from pa_ros.cli.main import main

sys.exit(main())
