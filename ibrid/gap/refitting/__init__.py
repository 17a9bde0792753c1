"""A model under repair: what is believed of its parameters, the noise, and its fit to sweeps held to both.

From outside: `model` (Model, Fitted), `noise`, `prior`, `refit`.
"""
