"""A simulated vehicle that speaks MAVLink: plant, controller, autopilot, world and sensors.

Read it from the inside out:

1. ``multirotor``: the rigid body and its rotors; ``wind``, ``battery``: what acts on it;
2. ``controller``: from a setpoint to rotor speeds by dynamic inversion;
3. ``navigator``, ``auto_flight``, ``mission``, ``offboard``, ``guided_reference``: where setpoints
   come from;
   ``commander``, ``failsafe``, ``failures``: modes, arming, and what goes wrong;
   ``flavour``, ``px4``, ``ardupilot``: whose names, numbers and habits;
4. ``parameters``, ``commands``, ``mission_transfer``, ``fence``, ``arm_authorization``,
   ``telemetry``, ``signing``, ``mavlink_link``, ``autopilot``: MAVLink bytes;
5. ``vehicle``: all of that as one object in virtual time;
6. ``field``, ``world``, ``sensor``, ``scanner``: obstacles, the truth about them, and what is seen
   of them;
7. ``scene``: vehicle, world and sensors together; ``link``: an imperfect radio;
8. ``config``, ``transport``, ``__main__``: the same live, over sockets, in real time.

Only the last item touches sockets and clocks.  The package shares no mathematics with ``onboard``,
so that an error there cannot cancel here.
"""
