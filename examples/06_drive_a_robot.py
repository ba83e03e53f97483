"""Drive a simulated robot along a fold of a running service; the fold waits for the robot."""

from __future__ import annotations

import argparse
import json
from urllib.request import ProxyHandler, build_opener

import mujoco
import numpy as np
from websockets.sync.client import connect

DAMPING_S = 0.2


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--url", default="http://127.0.0.1:8000")
    options.add_argument("--fold", help="its id; the newest verified fold that is listed if not")
    options.add_argument("--speed", type=float, default=1.0, help="1 keeps within the limits")
    options.add_argument("--stiffness", type=float, default=5.0, help="of servos; weak: 0.02")
    arguments = options.parse_args()
    directly = build_opener(ProxyHandler({})).open  # a proxy cannot reach this machine
    with directly(f"{arguments.url}/api/folds") as answer:
        verified = (f["id"] for f in json.load(answer)["folds"] if f["status"] == "verified")
    fold = arguments.fold or next(verified)
    with directly(f"{arguments.url}/api/folds/{fold}/model.xml") as answer:
        spec = mujoco.MjSpec.from_string(answer.read().decode())
    stiffness = arguments.stiffness * len(spec.bodies) ** 3  # long chains need stiffer servos
    for joint in spec.joints:
        if joint.type == mujoco.mjtJoint.mjJNT_HINGE:
            servo = spec.add_actuator(name=joint.name, target=joint.name)
            servo.trntype = mujoco.mjtTrn.mjTRN_JOINT
            servo.set_to_position(kp=stiffness, kv=DAMPING_S * stiffness)
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.timestep = 0.005
    model = spec.compile()
    robot = mujoco.MjData(model)
    address = arguments.url.replace("http", "ws", 1) + f"/api/folds/{fold}/play"
    with connect(
        f"{address}?speed={arguments.speed}&speeds=true", max_size=None, proxy=None
    ) as service:
        opening = json.loads(service.recv())
        if opening["is"] == "problem":
            raise SystemExit(opening["detail"])
        joints = [model.joint(name).qposadr[0] for name in opening["joint_names"]]
        servos = [model.actuator(name).id for name in opening["joint_names"]]
        least_s = arguments.speed / opening["rate_hz"]
        print(f"{len(joints)} joints, {opening['duration_s']:.1f} s at speed 1", flush=True)
        robot.qpos[joints] = opening["joint_angles_rad"]  # a real robot is first moved there
        service.send(json.dumps({"do": "report", "joint_angles_rad": robot.qpos[joints].tolist()}))
        for message in map(json.loads, service):
            if message["is"] == "target":
                lead = np.multiply(message["joint_speeds_rad_s"], DAMPING_S / arguments.speed)
                robot.ctrl[servos] = message["joint_angles_rad"] + lead
                passed_s = max(message["time_s"] - robot.time, least_s)  # late targets are left out
                mujoco.mj_step(model, robot, nstep=max(1, round(passed_s / model.opt.timestep)))
                error = np.abs(robot.qpos[joints] - message["joint_angles_rad"]).max()
                report = {"error_rad": error, "number": message["number"]}
                service.send(json.dumps({"do": "report"} | report))
            else:
                print(message, flush=True)
            if message["is"] == "end":
                return


if __name__ == "__main__":
    main()
