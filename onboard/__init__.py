"""The companion-computer daemon: contract, induction planner, monitors, setpoints.

Read it along the walk of a detection:

1. `onboard.daemon` takes bytes from Zenoh and MAVLink (`onboard.links`) and runs the rest in real
   time, by `onboard.clock`;
2. `onboard.autonomy` is the whole service without I/O, decided in ticks;
3. `onboard.detection_intake` reads detection frames and places them by `onboard.pose_history`;
   `onboard.obstacles` turns them into tracks, boxes and the obstacle of interest;
4. `onboard.navigator` flies: `onboard.itinerary` knows the leg, and `onboard.guidance` is the
   induction automaton (Fig. 14);
5. `onboard.planner` solves Eq. 17, and `onboard.certify` checks it before it is flown;
6. `onboard.mavlink` turns the plan into setpoints.

Beside the walk each monitor checks one assumption of those that `onboard.monitor` lists:

* the sensor: `onboard.detection_monitor`, `onboard.detection_consistency`;
* the estimate: `onboard.estimator_reset`, `onboard.position_quality`, `onboard.heading`;
* vehicle and air: `onboard.tracking`, `onboard.tilt_response`, `onboard.trim`, `onboard.wind`;
* who else commands, and time: `onboard.second_commander`, `onboard.loop_overrun`.

`onboard.departure` says why control is not taken, `onboard.adaptation` answers what fails by a
contract for what was seen.

Under them lies the mathematical core, which has no dependencies: `onboard.frames`,
`onboard.agility`, `onboard.region`, and the contract: `onboard.terms`, `onboard.derivation`,
`onboard.clauses`, `onboard.contract`.
"""
