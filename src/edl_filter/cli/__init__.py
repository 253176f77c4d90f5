"""The command line ``edl-filter``.

In: arguments and options. Out: files, text or JSON on standard output, and an exit code: 0 done; 3 done, but the result
is not to be trusted; 2 the input is wrong, with one message on standard error; 1 an error of the package. No command
imports a large package before it runs, so that its help is printed at once.

Read in this order: `commands` (the program and its list of commands); `reconstruction`, `flight_data`, `diagnosis` and
`campaign` (the commands: each parses its arguments, calls the workflow and prints); `options` (arguments and options of
several commands); `bash_words` (completion of words with a colon in bash); `_base` (exit codes, progress, JSON).
"""

from edl_filter.cli.commands import app, main

__all__ = ["app", "main"]
