"""A model under repair: what is believed of its parameters, the noise, and its fit to sweeps held
to both.

From outside of `gap`: `noise`, `prior`.
"""
