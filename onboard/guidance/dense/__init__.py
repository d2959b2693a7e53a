"""Best effort in dense fields: always with a certified way to rest in the space seen free.

`thread` flies (THREAD), `pause` looks around where nothing better certifies (PAUSE), `way_to_rest`
is what is held in both, and goes on in HOLD.
"""
