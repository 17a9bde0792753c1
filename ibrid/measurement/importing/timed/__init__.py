"""Recordings in time of others: which signal a column is, in which unit, and the voltage and the
current that they make.

From outside of `importing`: `comtrade_file`, `families`, `pscad_output`, `recording_files`,
`recording_table`.
"""
