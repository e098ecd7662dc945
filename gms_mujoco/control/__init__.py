"""Controllers of a servo axis, from PID to compensation of friction by an identified model.

Each is a callable of one observation of `ServoTracking`, made new for every episode:

    controller = PID(inertia, sample_time) + GMSObserver(plant, sample_time)
    torque = controller(observation)                                     # N m
    observation, *_ = env.step([torque / env.unwrapped.axes.torque_limit])

They add: a sum of controllers commands the sum of their torques. `follow` runs one on every axis of a vector
environment. Units are those of a hinge.
"""

from .base import ACCELERATION, AHEAD, ERROR, POSITION, REFERENCE, SPEED, TORQUE, VELOCITY, Controller
from .feedback import ADRC, PID, DisturbanceObserver
from .follow import Trace, follow
from .friction import (
    CoulombFeedforward,
    Feedforward,
    Follower,
    GMSFeedforward,
    GMSObserver,
    LuGreObserver,
    Oracle,
)
from .repetition import ILC

__all__ = [
    "ACCELERATION",
    "ADRC",
    "AHEAD",
    "ERROR",
    "ILC",
    "PID",
    "POSITION",
    "REFERENCE",
    "SPEED",
    "TORQUE",
    "VELOCITY",
    "Controller",
    "CoulombFeedforward",
    "DisturbanceObserver",
    "Feedforward",
    "Follower",
    "GMSFeedforward",
    "GMSObserver",
    "LuGreObserver",
    "Oracle",
    "Trace",
    "follow",
]
