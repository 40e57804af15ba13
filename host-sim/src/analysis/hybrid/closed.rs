//! The hybrid law closed around the sampled plant.
//!
//! The law's part is not written down a second time: it is [`HybridLaw::update`] itself, which is
//! linear inside its limits, evaluated on basis vectors.
//!
//! ```text
//! v_k     = c x_k
//! w_(k+1), u_k = law(w_k, v_k)
//! x_(k+1) = phi x_k + gamma u_(k-d)        d >= 1
//! ```

use super::plant::{DISTURBANCES, Disturbance, LoopPose, OUTPUTS, SampledPlant};
use crate::analysis::stability::eigenvalues;
use crate::planner::plan::Plan;
use flexor::control::{HybridLaw, HybridParameters, HybridState};
use flexor::model::ArmParameters;
use flexor::signals::{Measurement, PoseSetpoint, SaturationCounts};
use nalgebra::{Complex, DMatrix};

/// Numbers that the law remembers: of each joint the error before and the filtered rate, then joint
/// 1's integral, force integral, torque correction and the section's two.
const LAW_STATES: usize = 9;

/// The state's size in the plain units; small, so that no limit acts on it.
const BASIS: f64 = 1e-6;

/// The law as matrices, in deviations from the plan: `w+ = a w + b v`, `u = c w + d v`, with what
/// is measured in the order of [`OUTPUTS`]. What never acts, as an integral without a gain, is left
/// out.
#[derive(Clone, Debug)]
pub struct LinearHybrid {
    a: DMatrix<f64>,
    b: DMatrix<f64>,
    c: DMatrix<f64>,
    d: DMatrix<f64>,
    /// Control rate, Hz.
    tick_rate_hz: u32,
}

impl LinearHybrid {
    /// The law with `parameters` for `arm` at `pose` and `tick_rate_hz`, in the air if `free`; with
    /// `link1` false joint 2's part alone.
    pub fn new(
        parameters: &HybridParameters,
        arm: &ArmParameters,
        pose: &LoopPose,
        tick_rate_hz: u32,
        (free, link1): (bool, bool),
    ) -> Self {
        let law = HybridLaw::<f64>::new(parameters, arm, tick_rate_hz);
        let moment_arm = arm.link2_length_m * libm::sin(pose.normal_angle - pose.angle[1]);
        let respond = |memory: &[f64], measured: [f64; OUTPUTS]| {
            respond(&law, moment_arm, free, memory, measured)
        };
        let p = parameters;
        let torque_loop = match free {
            true => p.free.torque_loop_per_s,
            false => p.torque_loop_per_s,
        };
        let section = match free {
            true => p.free.section_frequency_rad_s,
            false => p.section_frequency_rad_s,
        };
        let acts = [
            link1,
            link1,
            link1 && p.joint1_integral_nm_rads > 0.0 && p.joint_stiffness_nm_rad[0] > 0.0,
            true,
            true,
            !free && p.force_integral_per_s > 0.0,
            torque_loop > 0.0,
            section > 0.0,
            section > 0.0,
        ];
        let kept: Vec<usize> = (0..LAW_STATES).filter(|i| acts[*i]).collect();
        let joints: &[usize] = if link1 { &[0, 1] } else { &[1] };
        let n = kept.len();
        let mut linear = Self {
            a: DMatrix::zeros(n, n),
            b: DMatrix::zeros(n, OUTPUTS),
            c: DMatrix::zeros(joints.len(), n),
            d: DMatrix::zeros(joints.len(), OUTPUTS),
            tick_rate_hz,
        };
        let mut write = |column: usize, of_state: bool, (memory, torque): (Vec<f64>, [f64; 2])| {
            let (state, command) = match of_state {
                true => (&mut linear.a, &mut linear.c),
                false => (&mut linear.b, &mut linear.d),
            };
            for (row, i) in kept.iter().enumerate() {
                state[(row, column)] = memory[*i] / BASIS;
            }
            for (row, joint) in joints.iter().enumerate() {
                command[(row, column)] = torque[*joint] / BASIS;
            }
        };
        for (column, i) in kept.iter().enumerate() {
            let mut memory = [0.0; LAW_STATES];
            memory[*i] = BASIS;
            write(column, true, respond(&memory, [0.0; OUTPUTS]));
        }
        for column in 0..OUTPUTS {
            let mut measured = [0.0; OUTPUTS];
            measured[column] = BASIS;
            write(column, false, respond(&[0.0; LAW_STATES], measured));
        }
        linear
    }
}

/// What the law remembers and asks for after one tick in which joint 2 has the `moment_arm` (m).
fn respond(
    law: &HybridLaw<f64>,
    moment_arm: f64,
    free: bool,
    memory: &[f64],
    [m1, m2, moment, force]: [f64; OUTPUTS],
) -> (Vec<f64>, [f64; 2]) {
    let mut state = HybridState {
        free,
        without_gauge: false,
        angle_error: Some([memory[0], memory[3]]),
        rate_error: [memory[1], memory[4]],
        place_integral: memory[2],
        force_integral: memory[5],
        torque_correction: memory[6],
        section: [memory[7], memory[8]],
    };
    // Only the moment arm depends on the pose; deviations are exact about zero.
    let setpoint = PoseSetpoint {
        torque: [0.0; 2],
        force: 0.0,
        motor: [0.0; 2],
        moment_arm,
    };
    let measured = Measurement {
        motor: [m1, m2],
        root_moment: moment,
        force,
        ..Measurement::default()
    };
    let demand = law.update(
        &mut state,
        &setpoint,
        &measured,
        &mut SaturationCounts::default(),
    );
    let [p1, p2] = state.angle_error.unwrap_or_default();
    let [r1, r2] = state.rate_error;
    let [x, y] = state.section;
    let memory = vec![
        p1,
        r1,
        state.place_integral,
        p2,
        r2,
        state.force_integral,
        state.torque_correction,
        x,
        y,
    ];
    (memory, demand.torque)
}

/// What a loop is tried with beyond what it is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stress {
    /// Factors on the torques' deviations, joint 1 and joint 2.
    pub gain: [f64; 2],
    /// Ticks of delay more than the plant has.
    pub ticks: usize,
}

impl Stress {
    /// None.
    pub const NONE: Self = Self {
        gain: [1.0; 2],
        ticks: 0,
    };
}

/// The loop from tick to tick.
#[derive(Clone, Debug)]
pub struct ClosedLoop {
    /// State: the plant's, the torques on their way (newest first), the law's memory.
    matrix: DMatrix<f64>,
    /// Where the plant's states end, and the law's begin.
    plant: usize,
    law: usize,
    /// Control period, s.
    period_s: f64,
}

impl ClosedLoop {
    /// `plant` with `law`, under `stress`.
    ///
    /// # Panics
    /// If one of them has both joints, the other joint 2 alone.
    pub fn new(plant: &SampledPlant, law: &LinearHybrid, stress: &Stress) -> Self {
        let (n, joints, w) = (plant.phi.nrows(), plant.gamma.ncols(), law.a.nrows());
        assert_eq!(joints, law.c.nrows(), "plant and law have the same joints");
        let delay = plant.delay_ticks + stress.ticks;
        let (first, memory) = (n, n + joints * delay);
        let size = memory + w;
        let mut matrix = DMatrix::zeros(size, size);
        matrix.view_mut((0, 0), (n, n)).copy_from(&plant.phi);
        let last = first + joints * (delay - 1);
        matrix
            .view_mut((0, last), (n, joints))
            .copy_from(&plant.gamma);
        for older in 1..delay {
            for joint in 0..joints {
                let (to, from) = (joints * older + joint, joints * (older - 1) + joint);
                matrix[(first + to, first + from)] = 1.0;
            }
        }
        let scaled = |mut command: DMatrix<f64>| {
            let gains = &stress.gain[2 - joints..];
            for (mut row, gain) in command.row_iter_mut().zip(gains) {
                row *= *gain;
            }
            command
        };
        let mut put = |row, column, block: DMatrix<f64>| {
            matrix
                .view_mut((row, column), block.shape())
                .copy_from(&block);
        };
        put(first, 0, scaled(&law.d * &plant.c));
        put(first, memory, scaled(law.c.clone()));
        put(memory, 0, &law.b * &plant.c);
        put(memory, memory, law.a.clone());
        Self {
            matrix,
            plant: n,
            law: memory,
            period_s: 1.0 / f64::from(law.tick_rate_hz),
        }
    }

    /// The slowest pole, 1/s: the logarithm of the largest eigenvalue over the period. Stable with a
    /// negative real part; infinite where the matrix is not finite.
    pub fn slowest(&self) -> Complex<f64> {
        let all = self.poles();
        let none = Complex::new(f64::INFINITY, 0.0);
        all.first().copied().unwrap_or(none)
    }

    /// The pole that is nearest to growing, where one that oscillates is to decay by a share
    /// `damping` of its frequency besides: the largest `re + damping |im|`, 1/s.
    pub fn least_decay(&self, damping: f64) -> f64 {
        let poles = self.poles();
        if poles.is_empty() {
            return f64::INFINITY;
        }
        let decay = poles.iter().map(|pole| pole.re + damping * pole.im.abs());
        // Not max(), which passes NaN over.
        decay.fold(
            f64::NEG_INFINITY,
            |most, x| if x <= most { most } else { x },
        )
    }

    /// Poles, 1/s, slowest first; those that decay within a tick are left out.
    pub fn poles(&self) -> Vec<Complex<f64>> {
        let mut poles: Vec<Complex<f64>> = eigenvalues(self.matrix.clone())
            .into_iter()
            .map(|z| {
                let size = libm::hypot(z.re, z.im);
                let angle = libm::atan2(z.im, z.re);
                Complex::new(libm::log(size), angle) / self.period_s
            })
            .filter(|pole| !(pole.re < -9.0 / self.period_s))
            .collect();
        poles.sort_by(|a, b| b.re.total_cmp(&a.re).then(b.im.total_cmp(&a.im)));
        poles
    }

    /// Root mean square of the force, N, under `noise`; `None` for a loop that does not settle.
    pub fn force_rms(
        &self,
        plant: &SampledPlant,
        law: &LinearHybrid,
        noise: &Noise,
    ) -> Option<f64> {
        let n = self.matrix.nrows();
        let size = n + 2 * DISTURBANCES;
        let mut a = DMatrix::zeros(size, size);
        a.view_mut((0, 0), (n, n)).copy_from(&self.matrix);
        let mut covariance = DMatrix::zeros(size, size);
        let mut force = DMatrix::zeros(1, size);
        let row = OUTPUTS - 1;
        force
            .view_mut((0, 0), (1, self.plant))
            .copy_from(&plant.c.row(row));
        let fast = libm::exp(-DISTURBANCE_FAST_RAD_S * self.period_s);
        let command = self.plant;
        let joints = plant.gamma.ncols();
        // How the law takes what is added to a measurement.
        let feed = |a: &mut DMatrix<f64>, column: usize, added: &DMatrix<f64>| {
            let (u, w) = (&law.d * added, &law.b * added);
            a.view_mut((command, column), (joints, 1)).copy_from(&u);
            a.view_mut((self.law, column), w.shape()).copy_from(&w);
        };
        for (k, (size, corner)) in noise.disturbances.into_iter().enumerate() {
            let (at, slow) = (n + 2 * k, libm::exp(-corner * self.period_s));
            let states = plant.disturbance.column(k);
            a.view_mut((0, at), (self.plant, 1)).copy_from(&states);
            let measured = plant.measured.column(k).into_owned();
            force[(0, at)] = measured[row];
            let measured = DMatrix::from_column_slice(OUTPUTS, 1, measured.as_slice());
            feed(&mut a, at, &measured);
            a[(at, at)] = fast;
            a[(at, at + 1)] = 1.0 - fast;
            a[(at + 1, at + 1)] = slow;
            covariance[(at + 1, at + 1)] = size * size * (1.0 - slow * slow);
        }
        for (v, size) in noise.measured.into_iter().enumerate() {
            let mut one = DMatrix::zeros(OUTPUTS, 1);
            one[(v, 0)] = size;
            let mut column = DMatrix::zeros(size_of(&covariance), 1);
            feed(&mut column, 0, &one);
            covariance += &column * column.transpose();
        }
        settled(a, covariance).map(|x| {
            let square = (&force * x * force.transpose())[(0, 0)];
            square.max(0.0).sqrt()
        })
    }
}

fn size_of(matrix: &DMatrix<f64>) -> usize {
    matrix.nrows()
}

/// The sum of `a^k w a'^k` over all k, by doubling; `None` where it does not end within a million
/// ticks.
fn settled(mut a: DMatrix<f64>, mut w: DMatrix<f64>) -> Option<DMatrix<f64>> {
    const DOUBLINGS: usize = 20;
    for _ in 0..DOUBLINGS {
        w += &a * &w * a.transpose();
        a = &a * &a;
        let size = a.amax();
        if size < 1e-9 {
            return Some(w);
        }
        if !(size < 1e12) {
            return None;
        }
    }
    None
}

/// Corner of the disturbances' second filter, rad/s: what is faster is noise.
const DISTURBANCE_FAST_RAD_S: f64 = 25.0;

/// What disturbs a loop: the bench's noises and what the spread of arms makes, as coloured noise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Noise {
    /// Root mean squares of the [`Disturbance`]s before their filters (N m, N, m), and the corners
    /// of their first filters, rad/s.
    pub disturbances: [(f64, f64); DISTURBANCES],
    /// White noise on the measurements a tick, rms, in the order of [`OUTPUTS`].
    pub measured: [f64; OUTPUTS],
}

impl Noise {
    /// As [`for_arm`](Self::for_arm), for the motion of `plan`: what the link's inertia asks of joint
    /// 2 is wrong by a tenth where masses are, as fast as the motion is.
    pub fn for_plan(plan: &Plan) -> Self {
        const MASS_ERROR: f64 = 0.1;
        let mut noise = Self::for_arm(&plan.model.arm, plan.task.normal_force.largest());
        let count = plan.points.len().max(1) as f64;
        let mean = plan.points.iter().map(|p| p.torque[1]).sum::<f64>() / count;
        let squares = plan.points.iter().map(|p| {
            let off = p.torque[1] - mean;
            off * off
        });
        let moving = (squares.sum::<f64>() / count).sqrt();
        // Half a turn of it in the time of the path.
        let speed = core::f64::consts::PI / plan.task.path.duration;
        let (rms, corner) = &mut noise.disturbances[Disturbance::RootTorque as usize];
        let fast = MASS_ERROR * moving;
        // The faster one's corner where it is the larger one.
        *corner = (*rms * *corner + fast * speed) / (*rms + fast);
        *rms = libm::hypot(*rms, fast);
        noise
    }

    /// The bench's on the paper's arm (a friction coefficient of 0.15, 2 mm of surface, 16384 counts
    /// a turn), brought to another `arm` by its length and the planned force (N).
    pub fn for_arm(arm: &ArmParameters, force_n: f64) -> Self {
        let moment = arm.link2_length_m * force_n;
        let mut disturbances = [(0.0, 1.0); DISTURBANCES];
        disturbances[Disturbance::RootTorque as usize] = (0.027 * moment, 1.0);
        disturbances[Disturbance::Tangential as usize] = (0.15 * force_n, 1.0);
        disturbances[Disturbance::Height as usize] = (0.0036 * arm.link2_length_m, 0.3);
        Self {
            disturbances,
            measured: [0.77e-4, 0.77e-4, 4.5e-4 * moment, 0.015 * force_n],
        }
    }
}
