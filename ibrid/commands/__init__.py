"""The commands of `ibrid`, a file per family; each declares its options and calls one function of
the package.
"""
