"""Figures, pages, tables in the terminal and notebook cards, from results and diagnoses; nothing is computed.

In: a `results.reader.ResultReader` or the content of a diagnosis. Out: matplotlib figures, ``report.html`` with plotly
figures, text.

Order of reading: `description` (a figure as data: curves, bands, marks, axes); `matplotlib_renderer` and
`plotly_renderer`, which draw it; one file per subject, which describes its figures (`trajectory`, `track`, `motion`,
`atmosphere`, `coefficients`, `rotation`, `constraints`, `diagnosis` and so on); `figures` (all figures of a run);
`text` and `sentences` (words and numbers that all outputs share); `html`, `terminal`, `notebook` and `plots` (outputs).
"""
