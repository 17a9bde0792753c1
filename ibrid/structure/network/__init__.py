"""What lies between the PCC and the terminals that a diagram means: passive elements, labels that
may be wrong.

From outside of `structure`: `outside`, `port_file`. Imports nothing else of `structure`.
"""
