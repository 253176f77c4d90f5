"""Files and environment of a program, independent of aerospace.

In: paths and contents of files. Out: files that are complete, contents that are checked, or an `InputError` that names
file and line.

Read in this order: `atomic` writes a file completely or not at all, `output_folder` checks and locks the folder that a
command writes, `csv_table` reads tables of numbers with error messages that name the line, `hdf5_guard` and
`yaml_guard` check files of unknown origin before their contents are read, `progress` names the environment variable by
which a command reports its progress to the program that started it.
"""
