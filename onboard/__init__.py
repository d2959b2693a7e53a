"""The companion-computer daemon: contract, induction planner, monitors, setpoints.

Read it along the walk of a detection:

1. `onboard.daemon` takes bytes from Zenoh and MAVLink, and nothing else has a socket or a clock;
2. `onboard.autonomy` is the whole service without I/O, decided in ticks;
3. `onboard.detection_intake` reads detection frames, `onboard.obstacles` turns them into tracks,
   boxes and the obstacle of interest;
4. `onboard.itinerary` knows the leg, and `onboard.guidance` is the induction automaton (Fig. 14);
5. `onboard.planner` solves Eq. 17, and `onboard.certify` checks it before it is flown;
6. `onboard.mavlink` turns the plan into setpoints.

Under them lies the mathematical core, which has no dependencies: `onboard.frames`,
`onboard.agility`, `onboard.region`, and the contract: `onboard.terms`, `onboard.derivation`,
`onboard.clauses`, `onboard.contract`.
"""
