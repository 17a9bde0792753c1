"""What commands print.

From outside: all of it, by `ibrid.commands`.
"""
