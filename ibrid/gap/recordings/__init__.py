"""Voltage and current in time: what they are judged by, the fit of a diagram with limits, and the
race of missing limits.

From outside of `gap`: `event_fit`, `event_misfit`, `event_noise`, `event_question`, `event_record`,
`joint_fit`, `limit_race`.
"""
