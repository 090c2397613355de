"""`python -m gateway.cli` is the `trueflank` command."""

from gateway.cli import main

main()
