"""A simulated vehicle that speaks MAVLink: plant, controller, autopilot, world and sensors.

Rooms, from the inside out; each imports only those before it:

1. ``plant``: rigid body, rotors and controller (compiled), estimator, battery, wind;
2. ``environment``: obstacles, sensors, an imperfect radio, truth log; ``config`` reads the file;
3. ``autopilot``: modes, arming, failsafes, missions, and the motion of the autonomous modes;
   ``autopilot.plan``: fence and rally points; ``autopilot.flavours``: PX4 and ArduPilot;
   ``autopilot.protocol``: MAVLink bytes, ``autopilot.protocol.files``: files on board;
4. ``vehicle``: one vehicle, and the scene of vehicle, world and sensors, in virtual time;
5. ``live``: the same in real time, over sockets and Zenoh; ``virtual``: flights from one seed,
   with faults.

Only ``live`` touches sockets and clocks.  Only ``virtual`` imports the daemon's flight code; the
rest shares no mathematics with ``onboard``, so that an error there cannot cancel here.
"""
