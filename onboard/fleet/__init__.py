"""Several Clearway vehicles: who flies at a site, and the leave to fly where others might."""
