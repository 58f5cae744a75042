"""`python -m lrm_ident.cli`."""

from lrm_ident.cli.app import main

main()
