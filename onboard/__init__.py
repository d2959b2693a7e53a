"""The companion-computer daemon: contract, induction planner, monitors, setpoints.

Read it along the walk of a detection:

1. `onboard.daemon` takes bytes from Zenoh and MAVLink (`onboard.mavlink.connections`) and runs the
   rest in real time, by `onboard.timing`;
2. `onboard.autonomy` is the whole service without I/O, decided in ticks;
3. `onboard.perception` reads detection frames, places them by where the vehicle was, and turns them
   into tracks, boxes and the obstacle of interest;
4. `onboard.guidance` flies by the induction automaton (Fig. 14): `phases` is its table;
5. `onboard.planning` solves Eq. 17 and certifies the result before it is flown;
6. `onboard.mavlink.endpoint` turns the plan into setpoints.

Beside the walk, `onboard.monitoring` checks each assumption of the contract: the sensor, the
autopilot's estimate (`estimator`), how the vehicle responds (`response`), who else commands, time.
`onboard.recording` writes what happened.

Under them lie `onboard.geometry`, `onboard.files`, `onboard.motion` and `onboard.contract`.
"""
