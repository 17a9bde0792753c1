"""The controlled comparison of learning: random, rules, the policy frozen, learning and mixed, on
the same hidden inverters.
"""
