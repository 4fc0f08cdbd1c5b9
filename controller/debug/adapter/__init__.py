"""Debug adapter: a recorded run in editors that speak the Debug Adapter Protocol."""
