"""Figures, pages, tables in the terminal and notebook cards, from results and diagnoses; nothing is computed.

In: a `results.reader.ResultReader` or the content of a diagnosis. Out: matplotlib figures, ``report.html`` with plotly
figures, text.

Read in this order: `description` (a figure as data: curves, bands, marks, axes) and `colours`; one file per subject,
which describes its figures: `trajectory`, `motion`, `attitude`, `track`, `constraints`, `domain` (panels over the
validation domain), `atmosphere`, `coefficients`, `rotation`, `residual_map`, `diagnosis`, `database_update`,
`campaign`; `label_layout` (positions of labels); `figures` (all figures of a run) and `plots` (the same in Python);
`matplotlib_renderer` and `plotly_renderer`, which draw a description, and `decimate` (long curves);
`text`, `sentences`, `instruments` and `next_step` (words and numbers that all outputs share); `figure_process` (figures
drawn in processes of their own); `html`, `terminal` and `notebook` (outputs).
"""
