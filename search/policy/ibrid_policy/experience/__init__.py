"""Experience for the policy: plausible inverters, damaged again and again, each fitted, with the
edit that repairs it.
"""
