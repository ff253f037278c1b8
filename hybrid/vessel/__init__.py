"""The vessel file and the compiled manoeuvring model: surge, sway and yaw of one ship."""
