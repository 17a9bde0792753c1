"""`python -m ibrid` is the command `ibrid`."""

import sys

from ibrid.cli import main

sys.exit(main())
