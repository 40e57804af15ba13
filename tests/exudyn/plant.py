"""The arm in Exudyn: a rigid link 1, and link 2 as ANCF cable elements, driven by given torques.

All is computed in the surface's own axes, x along the surface and y along its normal, into which the
arm is turned: the surface is then the condition that one nodal coordinate, the tip's y, stays.
"""

import time
from dataclasses import dataclass

import exudyn as exu
import exudyn.itemInterface as item
import numpy as np
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicHermiteSpline
from scipy.optimize import fsolve, root_scalar

# Newton's method stops at this residual, in EA times the number of elements: eight times what rounding
# leaves, since a strain is known to 1e-16 times the number of elements.
RESIDUAL_SHARE = 1e-14
# Damping time of the stretching, s: axial waves are not of interest.
AXIAL_DAMPING_S = 1e-4
# Spectral radius of the generalised-alpha method at infinite frequency.
SPECTRAL_RADIUS = 0.8


class PlantError(Exception):
    """What Exudyn could not do; the message is for the user."""


@dataclass(frozen=True)
class Settings:
    """Of the plant.

    bending_damping_s: retardation time of link 2's bending; elements: of link 2; axial_stiffness: EA,
    N, which Exudyn's link has and the plan's has not: it stretches by the axial force's share of it;
    step_s: time step; hold_s: time for which the first torques are held before the plan.
    """

    bending_damping_s: float
    elements: int
    axial_stiffness: float
    step_s: float
    hold_s: float


@dataclass(frozen=True)
class Response:
    """What the plant did, one row a step, plan's time and inertial axes.

    force: normal force of the tip on the surface, N, along `normal`, a unit vector on whose side the
    tip presses on the whole; theta10 and root_tangent: absolute angles, rad; root_rate: the tangent's,
    rad/s; nodes and slopes: of link 2 from joint 2 to the tip, (rows, nodes, 2), m and 1; stretch: how
    much longer link 2 is, in its lengths.
    """

    t: np.ndarray
    force: np.ndarray
    normal: np.ndarray
    theta10: np.ndarray
    root_tangent: np.ndarray
    root_rate: np.ndarray
    nodes: np.ndarray
    slopes: np.ndarray
    stretch: np.ndarray

    @property
    def tip(self):
        """The tip, (rows, 2), m."""
        return self.nodes[:, -1]

    def shape(self, row, arm):
        """Link 2 at a row as a fine line, (points, 2), m: the elements' own cubics."""
        places = np.linspace(0, arm.link2_length, self.nodes.shape[1])
        fine = np.linspace(0, arm.link2_length, 200)
        return CubicHermiteSpline(places, self.nodes[row], self.slopes[row])(fine)


def _turn(angle):
    """Matrix that turns a vector by `angle`, rad."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]])


def equilibrium(arm, gravity, torque, height, guess):
    """Resting shape of an inextensible elastica under `torque` (N m), its tip free to slide on
    y = `height` (m).

    Unknown are theta10, the root's tangent angle and the normal force f; `guess` has them. Along link
    2, with the load F(s) on what lies beyond s: EI psi' = M, M' = -t x F, M(0) = -tau2, M(r2) = 0.

    Returns the three and the solution s -> (x, y, psi, M).
    """
    length, density = arm.link2_length, arm.line_density

    def bend(theta10, root, f):
        def load(s):
            return gravity * (density * (length - s) + arm.tip_mass) + [0, -f]

        def slope(s, state):
            c, sn = np.cos(state[2]), np.sin(state[2])
            fx, fy = load(s)
            return [c, sn, state[3] / arm.bending_stiffness, sn * fx - c * fy]

        joint = arm.link1_length * np.array([np.cos(theta10), np.sin(theta10)])
        start = [*joint, root, -torque[1]]
        bent = solve_ivp(
            slope, (0, length), start, method="DOP853", rtol=1e-11, atol=1e-13, dense_output=True
        )
        return bent, joint, load(0)

    def defects(unknown):
        bent, joint, force = bend(*unknown)
        weight = arm.link1_mass / 2 * (joint[0] * gravity[1] - joint[1] * gravity[0])
        moment1 = torque[0] - torque[1] + weight + joint[0] * force[1] - joint[1] * force[0]
        return [bent.y[3, -1], bent.y[1, -1] - height, moment1]

    for f in (guess[2], -guess[2]):
        unknown, _, found, _ = fsolve(defects, [guess[0], guess[1], f], xtol=1e-13, full_output=True)
        if np.abs(defects(unknown)).max() < 1e-8:
            return unknown, bend(*unknown)[0].sol
    raise PlantError(
        "the plan's first torques hold the arm nowhere near its first angles: a plan that begins at rest "
        "is accepted"
    )


class _Model:
    """The mechanism in Exudyn, and what is read from it."""

    def __init__(self, arm, gravity, settings, theta10, shape):
        """At the angle `theta10` and the `shape` of link 2 that `equilibrium` returns; `gravity` in the
        surface's axes."""
        self.container = exu.SystemContainer()
        self.mbs = self.container.AddSystem()
        self.start_theta10 = theta10
        self.settings = settings
        self.residual = RESIDUAL_SHARE * settings.axial_stiffness * settings.elements
        ground = self.mbs.AddObject(item.ObjectGround())
        self.ground = self.mbs.AddMarker(item.MarkerBodyPosition(bodyNumber=ground))
        joint2 = self._link1(arm, gravity, theta10)
        self._link2(arm, gravity, shape, joint2)
        self._end(self.nodes[0], 0.0, arm.root_inertia, gravity)
        self._end(self.nodes[-1], arm.tip_mass, arm.tip_inertia, gravity)
        self._surface()
        self._sensors()
        self.mbs.Assemble()

    def _link1(self, arm, gravity, theta10):
        """Link 1 on its joint; returns the marker of joint 2."""
        add, r1 = self.mbs, arm.link1_length
        middle = r1 / 2 * np.array([np.cos(theta10), np.sin(theta10)])
        self.node1 = add.AddNode(item.NodeRigidBody2D(referenceCoordinates=[*middle, theta10]))
        body = add.AddObject(
            item.ObjectRigidBody2D(
                mass=arm.link1_mass, inertia=arm.link1_mass * r1**2 / 12, nodeNumber=self.node1
            )
        )
        near, centre, far = (
            add.AddMarker(item.MarkerBodyRigid(bodyNumber=body, localPosition=[x, 0, 0]))
            for x in (-r1 / 2, 0, r1 / 2)
        )
        add.AddObject(item.ObjectJointRevolute2D(markerNumbers=[self.ground, near]))
        add.AddLoad(item.LoadForceVector(markerNumber=centre, loadVector=[*(arm.link1_mass * gravity), 0]))
        # Torques of the drives: joint 1's on link 1, joint 2's between link 1 and link 2's root.
        self.torques = [(self._torque(near), 0, 1.0), (self._torque(far), 1, -1.0)]
        return far

    def _torque(self, marker):
        return self.mbs.AddLoad(item.LoadTorqueVector(markerNumber=marker, loadVector=[0, 0, 0]))

    def _link2(self, arm, gravity, shape, joint2):
        """Link 2: cable elements whose first slope vector is the root that joint 2's motor turns."""
        add, n = self.mbs, self.settings.elements
        length = arm.link2_length / n
        states = np.array([shape(i * length) for i in range(n + 1)])
        # Position and slope vector of every node at the beginning, which Exudyn counts coordinates from.
        self.reference = np.column_stack([states[:, :2], np.cos(states[:, 2]), np.sin(states[:, 2])])
        self.nodes = [add.AddNode(item.NodePoint2DSlope1(referenceCoordinates=row)) for row in self.reference]
        cables = [
            add.AddObject(
                item.ObjectANCFCable2D(
                    length=length,
                    massPerLength=arm.line_density,
                    bendingStiffness=arm.bending_stiffness,
                    bendingDamping=arm.bending_stiffness * self.settings.bending_damping_s,
                    axialStiffness=self.settings.axial_stiffness,
                    axialDamping=self.settings.axial_stiffness * AXIAL_DAMPING_S,
                    nodeNumbers=[self.nodes[i], self.nodes[i + 1]],
                )
            )
            for i in range(n)
        ]
        for cable in cables:
            marker = add.AddMarker(item.MarkerBodyMass(bodyNumber=cable))
            add.AddLoad(item.LoadMassProportional(markerNumber=marker, loadVector=[*gravity, 0]))
        root, tip = (
            add.AddMarker(item.MarkerBodyRigid(bodyNumber=cables[i], localPosition=[x, 0, 0]))
            for i, x in ((0, 0), (-1, length))
        )
        add.AddObject(item.ObjectJointRevolute2D(markerNumbers=[joint2, root]))
        self.torques.append((self._torque(root), 1, 1.0))
        self.friction = add.AddLoad(item.LoadForceVector(markerNumber=tip, loadVector=[0, 0, 0]))

    def _end(self, node, mass, inertia, gravity):
        """A body of `mass` (kg) and `inertia` (kg m^2) fixed to an end of link 2.

        The slope vector's length stays 1 but for the stretch of some 1e-6, so its kinetic energy
        inertia |slope'|^2 / 2 is that of the rotation.
        """
        if mass == 0 and inertia == 0:
            return
        self.mbs.AddObject(
            item.ObjectGenericODE2(
                nodeNumbers=[node],
                massMatrix=np.diag([mass, mass, inertia, inertia]),
                forceVector=[*(mass * gravity), 0, 0],
            )
        )

    def _surface(self):
        """Holds the tip's y where it is, by a constraint whose multiplier is the tip's force on the surface
        along y; and link 1's angle, which `rest` lets go."""
        add = self.mbs
        fixed = add.AddMarker(
            item.MarkerNodeCoordinate(nodeNumber=add.AddNode(item.NodePointGround()), coordinate=0)
        )
        tip = add.AddMarker(item.MarkerNodeCoordinate(nodeNumber=self.nodes[-1], coordinate=1))
        self.contact = add.AddObject(item.ObjectConnectorCoordinate(markerNumbers=[fixed, tip]))
        turned = add.AddMarker(item.MarkerNodeCoordinate(nodeNumber=self.node1, coordinate=2))
        self.hold = add.AddObject(item.ObjectConnectorCoordinate(markerNumbers=[fixed, turned]))

    def _sensors(self):
        kinds, stored = exu.OutputVariableType, {"storeInternal": True, "writeToFile": False}

        def node(number, kind):
            return self.mbs.AddSensor(item.SensorNode(nodeNumber=number, outputVariableType=kind, **stored))

        self.read_theta10 = node(self.node1, kinds.Coordinates)
        self.read_root_rate = node(self.nodes[0], kinds.Coordinates_t)
        self.read_nodes = [node(number, kinds.Coordinates) for number in self.nodes]
        self.read_force = self.mbs.AddSensor(
            item.SensorObject(objectNumber=self.contact, outputVariableType=kinds.Force, **stored)
        )

    def drive(self, torque, friction):
        """Sets the torques (two, N m) and the force that friction has on the tip along x, N."""
        for load, joint, sign in self.torques:
            self.mbs.SetLoadParameter(load, "loadVector", [0, 0, sign * float(torque[joint])])
        self.mbs.SetLoadParameter(self.friction, "loadVector", [float(friction), 0, 0])

    def rest(self):
        """Goes to Exudyn's own static equilibrium, which becomes the state to start in.

        The joints' reactions turn with link 1, which Exudyn's Jacobian leaves out, and Newton's method
        diverges from a millimetre away. So theta10 is held, where the Jacobian is exact, and moved until
        nothing needs to hold it.
        """
        s = exu.SimulationSettings()
        s.solutionSettings.writeSolutionToFile = False
        s.staticSolver.verboseMode = 0
        s.staticSolver.numberOfLoadSteps = 1
        s.staticSolver.newton.relativeTolerance = 1e-14
        s.staticSolver.newton.absoluteTolerance = self.residual
        s.staticSolver.newton.maxIterations = 50

        def holding_torque(offset):
            self.mbs.SetObjectParameter(self.hold, "offset", float(offset))
            self.mbs.SolveStatic(s, updateInitialValues=True)
            return self.mbs.GetObjectOutput(self.hold, exu.OutputVariableType.Force)

        try:
            root_scalar(holding_torque, x0=0.0, x1=1e-5, xtol=1e-11, maxiter=20)
        except exu.SolverError as error:
            raise PlantError(
                "Exudyn finds no rest under the plan's first torques: other --elements, or a plan that "
                "begins at rest, are accepted"
            ) from error
        self.mbs.SetObjectParameter(self.hold, "activeConnector", False)

    def move(self, torque, friction):
        """Integrates in time, over as many steps as `torque` (steps, 2) and `friction` (steps) have
        rows; a row holds for the end of its step."""
        s, h = exu.SimulationSettings(), self.settings.step_s
        steps = len(torque)

        def before_step(mbs, t):
            row = min(max(round(t / h) - 1, 0), steps - 1)
            self.drive(torque[row], friction[row])
            return True

        self.mbs.SetPreStepUserFunction(before_step)
        s.solutionSettings.writeSolutionToFile = False
        s.solutionSettings.sensorsWritePeriod = h
        s.timeIntegration.verboseMode = 0
        s.timeIntegration.numberOfSteps = steps
        s.timeIntegration.endTime = steps * h
        s.timeIntegration.newton.useModifiedNewton = True
        s.timeIntegration.newton.relativeTolerance = 1e-14
        s.timeIntegration.newton.absoluteTolerance = self.residual
        s.timeIntegration.generalizedAlpha.spectralRadius = SPECTRAL_RADIUS
        try:
            self.mbs.SolveDynamic(s)
        except exu.SolverError as error:
            raise PlantError(
                f"Exudyn's time integration fails at {self.mbs.systemData.GetTime():.6g} s: a smaller "
                "--step, or other --elements, are accepted"
            ) from error

    def stored(self, sensor):
        """What a sensor stored: (rows, values), without the time."""
        return self.mbs.GetSensorStoredData(sensor)[:, 1:]


def respond(arm, plan, settings):
    """Drives the plan's torques, open loop, into the arm in Exudyn, from rest under the first of them:
    a `Response` and the seconds that it took."""
    # The surface's x points to positive a1 (a vertical one's to a2): the paper's surface needs no turn.
    along = plan.direction
    travel = 1.0 if along[0] > 1e-9 or (along[0] > -1e-9 and along[1] > 0) else -1.0
    turn = np.arctan2(*(travel * along)[::-1])
    to_surface = _turn(-turn)
    gravity = to_surface @ np.array(arm.gravity, float)
    height = (to_surface @ plan.tip[0])[1]
    guess = [plan.angle[0, 0] - turn, plan.angle[0, 1] + plan.root_slope[0] - turn, plan.normal_force[0]]
    (theta10, root, force), shape = equilibrium(arm, gravity, plan.torque[0], height, guess)

    begun = time.perf_counter()
    model = _Model(arm, gravity, settings, theta10, shape)
    model.drive(plan.torque[0], 0.0)
    model.rest()
    h = settings.step_s
    steps = round((settings.hold_s + plan.t[-1] - plan.t[0]) / h)
    t = plan.t[0] - settings.hold_s + h * np.arange(1, steps + 1)
    model.move(plan.torque_at(t), -travel * plan.smooth(plan.friction, t))
    return _read(model, plan, turn, force, time.perf_counter() - begun)


def _read(model, plan, turn, rest_force, seconds):
    """The `Response` that the sensors stored, back in inertial axes, and the `seconds` that it took."""
    settings, stored = model.settings, model.stored
    force = stored(model.read_force)[:, 0]
    if abs(force[0] - rest_force) > 1e-3 * max(1.0, abs(rest_force)):
        raise PlantError(
            f"Exudyn's equilibrium presses with {force[0]:.6g} N, that of an elastica under the same torques "
            f"with {rest_force:.6g} N: a plan that begins at rest, and more --elements, are accepted"
        )
    nodes = np.stack([stored(sensor) for sensor in model.read_nodes], axis=1) + model.reference
    slopes, rate = nodes[:, :, 2:], stored(model.read_root_rate)[:, 2:]
    root = slopes[:, 0]
    stretch = np.trapezoid(np.hypot(*slopes.T) - 1, axis=0) / settings.elements
    t = plan.t[0] - settings.hold_s + settings.step_s * np.arange(len(force))
    presses = np.sign((force * plan.smooth(plan.normal_force, t)).sum())
    return (
        Response(
            t=t,
            force=presses * force,
            normal=presses * np.array([-np.sin(turn), np.cos(turn)]),
            theta10=turn + model.start_theta10 + stored(model.read_theta10)[:, 2],
            root_tangent=turn + np.unwrap(np.arctan2(root[:, 1], root[:, 0])),
            root_rate=(root[:, 0] * rate[:, 1] - root[:, 1] * rate[:, 0]) / (root**2).sum(axis=1),
            nodes=nodes[:, :, :2] @ _turn(turn).T,
            slopes=slopes @ _turn(turn).T,
            stretch=stretch,
        ),
        seconds,
    )
