"""Train a policy that compensates friction, without a learning framework, and test it against the PID it helps.

Training takes place on frictions drawn around the servo axis; the test episodes are fixed, some with frictions that
were held out. Printed is by how much the policy lowers the tracking error. More generations, a robot of your own:
`gms-mujoco train --help`; stable-baselines3: `gms_mujoco.sb3`.
"""

import argparse

from gms_mujoco.learn import train


def main(generations: int = 10) -> None:
    result = train(generations, population=16, episodes=4, episode_steps=500)
    print(result)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("generations", nargs="?", type=int, default=10, help="default: 10")
    main(parser.parse_args().generations)
