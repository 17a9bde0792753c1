"""What a fitted candidate lacks: a first look at every edit, ranked, and by what candidates are compared.

From outside: `diagnosis`, `first_look`, `rankings`, `merit`.
"""
