"""Guidance: which trajectory is flown, tick by tick, by the induction automaton (Fig. 14).

`phases` is the automaton.  `navigator` dispatches to the parts: `leg_progress` starts and ends
legs, `cruise` flies along them, `avoidance_step` plans around obstacles, `adaptation_ladder` and
`fallback` respond where an assumption fails.  `dense` flies with best effort.  They share one
`situation`, which holds the `reference` that is flown and the `route`.
"""
