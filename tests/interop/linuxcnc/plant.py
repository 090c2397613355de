#!/usr/bin/python3
"""The mill's mechanics as a HAL component: from where each motor stands to where its slide or table truly stands.

Motor -> play (lost motion) -> screw (pitch error and a wave of each turn). Positions in mm or deg, all else too.
"""

import math
import time

import hal

PLAY = (0.008, 0.0, 0.0, 0.004)
PITCH = (6e-5, -5e-5, 0.0, 2e-5)  # per mm or deg
WAVE = ((0.002, 40.0), (0.002, 25.0), (0.0, 1.0), (0.005, 90.0))  # amplitude, period


def screw(joint: int, nut: float) -> float:
    """Where the slide stands when the nut is driven to `nut`."""
    size, period = WAVE[joint]
    return nut * (1.0 + PITCH[joint]) + size * math.sin(2.0 * math.pi * nut / period)


def main() -> None:
    """Follow the motors until the kernel ends this component."""
    plant = hal.component("plant")
    for joint in range(4):
        plant.newpin(f"motor-{joint}", hal.HAL_FLOAT, hal.HAL_IN)
        plant.newpin(f"true-{joint}", hal.HAL_FLOAT, hal.HAL_OUT)
    plant.ready()
    nut = [0.0] * 4
    while True:
        for joint in range(4):
            motor, half = plant[f"motor-{joint}"], PLAY[joint] / 2.0
            nut[joint] = min(max(nut[joint], motor - half), motor + half)
            plant[f"true-{joint}"] = screw(joint, nut[joint])
        time.sleep(0.001)


if __name__ == "__main__":
    main()
