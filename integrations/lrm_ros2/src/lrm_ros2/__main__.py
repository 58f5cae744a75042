"""Entry of `python -m lrm_ros2`."""

import sys

from lrm_ros2.command import main

sys.exit(main())
