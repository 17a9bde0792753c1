"""What a fitted candidate lacks: every edit tried for a few steps and ranked, and by what
candidates are compared.

From outside of `ibrid_search`: `oddities`.
"""
