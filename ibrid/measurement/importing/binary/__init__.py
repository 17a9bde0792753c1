"""Arrays, cells and numbers of files that are no plain text, by their names: workbooks, MATLAB,
NumPy, HDF5, Parquet, COMTRADE.

From outside of `importing`: nothing.
"""
