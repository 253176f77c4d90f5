"""Files and environment of a program, independent of aerospace.

`atomic` writes a file completely or not at all, `output_folder` checks and locks the folder that a command writes,
`csv_table` reads tables of numbers with error messages that name the line, `progress` names the environment variable by
which a command reports its progress to the program that started it.
"""
