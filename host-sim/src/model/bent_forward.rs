//! Forward dynamics of the arm with a bent link: accelerations from state and torques, in the air, with
//! a given contact force, or with the tip held on a surface. The equations are those of
//! `link_dynamics`.
//!
//! With the generalised coordinates `x = (theta10, theta20, w)` they read
//! `M x'' + h = B tau - J' lambda`. The mass matrix is put together from the velocities of the link's
//! points, along n(theta20) `(r1 c, X, N)` and along e(theta20) `(r1 s, -w, -P)`, where
//! `P = integral of sigma N'` up to the point is how far a change of the unknowns draws it towards
//! joint 2. `h` is what the motion takes without accelerations.

use crate::model::arm_model::ArmModel;
use crate::model::bending::{Bent, Given};
use crate::model::configuration::{Configuration, State, Surface};
use crate::model::link::{Link, LinkModel, POINTS};
use crate::model::link_dynamics::required_into;
use flexor::model::JointMotion;
use flexor::number::Real;

/// Memory that [`BentArm`] works in, and what it leaves: the arm at an instant.
#[derive(Clone, Debug)]
pub struct BentArm<T> {
    /// Nodal unknowns, their rates, and zeros.
    nodal: [Vec<T>; 3],
    bent: Bent<T>,
    /// Mass matrix, lower triangle, row by row; then its factor.
    mass: Vec<T>,
    /// `-P` at the beginning of an element; at the end of all, of the tip.
    drawn: Vec<T>,
    /// `B tau - h`, then the accelerations that it makes.
    acceleration: Vec<T>,
    /// The contact's row J, then the accelerations that a force of 1 N takes away.
    contact: [Vec<T>; 2],
}

/// First moments of an element.
struct Moments<T> {
    /// Its mass, kg.
    mass: f64,
    /// Of its points' places along the chord and off it, kg m.
    along: T,
    off: T,
    /// Of what its own unknowns draw its points by.
    draw: [T; 4],
}

/// Place of row `i` in a lower triangle.
const fn row(i: usize) -> usize {
    i * (i + 1) / 2
}

impl<T: Real> BentArm<T> {
    /// For `model`, or another one with as many unknowns.
    pub fn new(model: &ArmModel) -> Self {
        let n = model.dof();
        let size = n + 2;
        Self {
            nodal: [(); 3].map(|()| vec![T::ZERO; n]),
            bent: Bent::empty(&model.link),
            mass: vec![T::ZERO; row(size)],
            drawn: vec![T::ZERO; n],
            acceleration: vec![T::ZERO; size],
            contact: [(); 2].map(|()| vec![T::ZERO; size]),
        }
    }

    /// Takes over the shape of `state`, in modal coordinates.
    fn bend(&mut self, model: &ArmModel, state: State<'_, T>) {
        let [w, w_t, _] = &mut self.nodal;
        for (nodal, modal) in [(w, state.q()), (w_t, state.q_rate())] {
            nodal.fill(T::ZERO);
            for (shape, q) in model.shapes.column_iter().zip(modal) {
                for (nodal, shape) in nodal.iter_mut().zip(shape.iter()) {
                    *nodal += q.scaled(*shape);
                }
            }
        }
        let [w, w_t, zero] = &self.nodal;
        self.bent.bend(&model.link, &Given([w, w_t, zero]));
    }

    /// The chord's length (m) and its rate, and the angle of link 2's root against it (rad) and its rate,
    /// in `state`.
    pub fn shape(&mut self, model: &ArmModel, state: State<'_, T>) -> [[T; 2]; 2] {
        self.bend(model, state);
        let ([length, length_t, _], [angle, angle_t, _]) = (self.bent.chord, self.bent.root.angle);
        [[length, length_t], [angle, angle_t]]
    }

    /// Accelerations `(theta10'', theta20'')` (rad/s^2), and the contact force along the normal of `surface` (N, pressing positive), for the arm in `state` with
    /// `torque` (N m, friction already taken off) on the joints and its tip held on the surface, from both
    /// sides: the force may come out negative. Modal accelerations are written to `q_acceleration`.
    ///
    /// # Panics
    /// If `state` or `q_acceleration` has not `model`'s number of modes.
    pub fn on_surface(
        &mut self,
        model: &ArmModel,
        surface: &Surface,
        state: State<'_, T>,
        torque: impl FnOnce([T; 2]) -> [T; 2],
        q_acceleration: &mut [T],
    ) -> Accelerations<T> {
        let configuration = Configuration::new(model, state.angle());
        self.bend(model, state);
        let torque = torque(self.motor_rates(state));
        self.set_up(model, &configuration, state, torque, [T::ZERO; 2]);
        let normal = surface.normal.map(T::from_f64);
        let bias = self.contact_row(model, &configuration, state, normal);
        let [row, taken] = &mut self.contact;
        taken.copy_from_slice(row);
        factor(&mut self.mass, self.acceleration.len());
        solve(&self.mass, &mut self.acceleration);
        solve(&self.mass, taken);
        let along = |x: &[T]| row.iter().zip(x).fold(T::ZERO, |sum, (j, x)| sum + *j * *x);
        let force = (along(&self.acceleration) + bias) / along(taken);
        for (acceleration, taken) in self.acceleration.iter_mut().zip(taken) {
            *acceleration -= force * *taken;
        }
        self.found(model, force, q_acceleration)
    }

    /// The same for a tip that meets `force` (N, of the tip on what it touches, inertial axes), in the state
    /// whose [`shape`](Self::shape) was asked for last.
    ///
    /// # Panics
    /// If `state` or `q_acceleration` has not `model`'s number of modes.
    pub fn under_force(
        &mut self,
        model: &ArmModel,
        configuration: &Configuration<T>,
        state: State<'_, T>,
        torque: [T; 2],
        force: [T; 2],
        q_acceleration: &mut [T],
    ) -> Accelerations<T> {
        self.set_up(model, configuration, state, torque, force);
        factor(&mut self.mass, self.acceleration.len());
        solve(&self.mass, &mut self.acceleration);
        self.found(model, T::ZERO, q_acceleration)
    }

    /// Acceleration of the root's angle against the chord, rad/s^2, as it was found last.
    pub fn root_acceleration(&self) -> T {
        let root = &self.bent.root;
        root.angle[2] + root.by_slope * self.acceleration[2]
    }

    /// Rates of the motors, rad/s: of link 1, and of link 2's root tangent against it.
    fn motor_rates(&self, state: State<'_, T>) -> [T; 2] {
        let [rate1, rate2] = state.rate();
        [rate1, rate2 + self.bent.root.angle[1] - rate1]
    }

    /// The accelerations, the nodal ones in modal coordinates.
    fn found(&self, model: &ArmModel, force: T, q_acceleration: &mut [T]) -> Accelerations<T> {
        q_acceleration.fill(T::ZERO);
        let nodal = &self.acceleration[2..];
        for (column, w) in model.coordinates.column_iter().zip(nodal) {
            for (q, c) in q_acceleration.iter_mut().zip(column.iter()) {
                *q += w.scaled(*c);
            }
        }
        Accelerations {
            angle: [self.acceleration[0], self.acceleration[1]],
            force,
        }
    }

    /// Mass matrix and `B tau - h`.
    fn set_up(
        &mut self,
        model: &ArmModel,
        configuration: &Configuration<T>,
        state: State<'_, T>,
        torque: [T; 2],
        force: [T; 2],
    ) {
        let joint = JointMotion {
            angle: state.angle(),
            rate: state.rate(),
            acceleration: [T::ZERO; 2],
        };
        let rows = &mut self.acceleration[2..];
        let (root, taken) = required_into(model, &self.bent, &joint, configuration, force, rows);
        for row in rows.iter_mut() {
            *row = -*row;
        }
        rows[0] += root * torque[1];
        self.acceleration[1] = torque[1] - taken[1];
        self.acceleration[0] = torque[0] - torque[1] - (taken[0] - taken[1]);
        self.fill_mass(model, configuration);
    }

    /// The mass matrix, and how far the unknowns draw the tip.
    fn fill_mass(&mut self, model: &ArmModel, configuration: &Configuration<T>) {
        let r1 = model.arm.link1_length_m;
        let joint2 = [configuration.c.scaled(r1), configuration.s.scaled(r1)];
        self.mass.fill(T::ZERO);
        self.mass[0] = T::from_f64(model.link1_inertia);
        self.drawn.fill(T::ZERO);
        for begin in (0..self.bent.sections.len()).step_by(POINTS) {
            let moments = self.add_element(&model.link, joint2, begin);
            if model.link.kind.model == LinkModel::Geometric {
                self.add_drawn(&model.link, joint2[1], begin, &moments);
            }
        }
        self.add_ends(model, joint2);
    }

    /// How far the unknowns of the element whose first point is `begin` draw its points along the chord: `-P`
    /// without what earlier elements do.
    fn own_draws(&self, link: &Link, begin: usize) -> [[T; 4]; POINTS] {
        let mut draws = [[T::ZERO; 4]; POINTS];
        if link.kind.model == LinkModel::Linear {
            return draws;
        }
        for (draws, weights) in draws.iter_mut().zip(&link.partial) {
            for (weight, from) in weights.iter().zip(begin..) {
                let shortening = self.bent.sections[from].shortening.scaled(*weight);
                for (d, f) in draws.iter_mut().zip(link.sections[from].slope()) {
                    *d -= shortening.scaled(*f);
                }
            }
        }
        draws
    }

    /// Adds an element's points, but for what earlier elements draw them by.
    fn add_element(&mut self, link: &Link, [sway, surge]: [T; 2], begin: usize) -> Moments<T> {
        let (first, count) = (link.sections[begin].first, link.sections[begin].count);
        let draws = self.own_draws(link, begin);
        let mut moments = Moments {
            mass: 0.0,
            along: T::ZERO,
            off: T::ZERO,
            draw: [T::ZERO; 4],
        };
        let mass = &mut self.mass;
        for (point, draw) in draws.iter().enumerate() {
            let section = &self.bent.sections[begin + point];
            let own = link.sections[begin + point].value();
            let dm = link.mass[point];
            let ([w, ..], [x, ..]) = (section.off, section.along);
            let (dm_w, dm_x) = (w.scaled(dm), x.scaled(dm));
            moments.mass += dm;
            moments.along += dm_x;
            moments.off += dm_w;
            mass[2] += x * dm_x + w * dm_w;
            for i in 0..count {
                moments.draw[i] += draw[i].scaled(dm);
                let line = row(2 + first + i);
                mass[line] += (sway.scaled(own[i]) + surge * draw[i]).scaled(dm);
                mass[line + 1] += dm_x.scaled(own[i]) - dm_w * draw[i];
                for j in 0..=i {
                    let across = T::from_f64(dm * own[i] * own[j]);
                    mass[line + 2 + first + j] += across + (draw[i] * draw[j]).scaled(dm);
                }
            }
        }
        mass[0] += (sway * sway + surge * surge).scaled(moments.mass);
        mass[1] += sway * moments.along - surge * moments.off;
        moments
    }

    /// Adds what earlier elements draw an element with these `moments` by, the same at all its points; then
    /// what its own unknowns draw all that is beyond it.
    fn add_drawn(&mut self, link: &Link, surge: T, begin: usize, moments: &Moments<T>) {
        let (first, count) = (link.sections[begin].first, link.sections[begin].count);
        let mass = &mut self.mass;
        for i in 0..first + count {
            let drawn = self.drawn[i];
            let line = row(2 + i);
            let whole = drawn.scaled(moments.mass);
            mass[line] += surge * whole;
            mass[line + 1] -= moments.off * drawn;
            for j in 0..=i {
                mass[line + 2 + j] += whole * self.drawn[j];
            }
            // The element's own draws with those of all before, and the other way round.
            if let Some(own) = i.checked_sub(first) {
                for j in 0..=i {
                    mass[line + 2 + j] += moments.draw[own] * self.drawn[j];
                }
            }
            for (j, moment) in (first..=i).zip(&moments.draw[..count]) {
                mass[line + 2 + j] += drawn * *moment;
            }
        }
        for (weight, from) in link.whole.iter().zip(begin..) {
            let shortening = self.bent.sections[from].shortening.scaled(*weight);
            for (i, f) in (first..).zip(link.sections[from].slope()) {
                self.drawn[i] -= shortening.scaled(*f);
            }
        }
    }

    /// Adds tip mass, root and tip inertia to the mass matrix.
    fn add_ends(&mut self, model: &ArmModel, [sway, surge]: [T; 2]) {
        let arm = &model.arm;
        let n = self.drawn.len();
        let length = self.bent.chord[0];
        let mass = &mut self.mass;
        let m = arm.tip_mass_kg;
        if m > 0.0 {
            mass[0] += (sway * sway + surge * surge).scaled(m);
            mass[1] += (sway * length).scaled(m);
            mass[2] += (length * length).scaled(m);
            for i in 0..n {
                let drawn = self.drawn[i].scaled(m);
                let line = row(2 + i);
                mass[line] += surge * drawn;
                for j in 0..=i {
                    mass[line + 2 + j] += drawn * self.drawn[j];
                }
            }
        }
        let ends = [
            (arm.root_inertia_kgm2, self.bent.root.by_slope, 0),
            (arm.tip_inertia_kgm2, self.bent.tip.by_slope, n - 1),
        ];
        for (inertia, by_slope, i) in ends {
            if inertia > 0.0 {
                let turned = by_slope.scaled(inertia);
                mass[2] += T::from_f64(inertia);
                mass[row(2 + i) + 1] += turned;
                mass[row(2 + i) + 2 + i] += turned * by_slope;
            }
        }
    }

    /// The contact's row for a unit `normal`, to [`contact`](Self::contact), and the tip's acceleration along
    /// it without accelerations of the coordinates.
    fn contact_row(
        &mut self,
        model: &ArmModel,
        configuration: &Configuration<T>,
        state: State<'_, T>,
        normal: [T; 2],
    ) -> T {
        let r1 = model.arm.link1_length_m;
        let [length, length_t, length_tt] = self.bent.chord;
        let [rate1, rate2] = state.rate();
        let along = configuration.along_e2(normal);
        let across = configuration.along_n2(normal);
        let row = &mut self.contact[0];
        row[0] = configuration.along_n1(normal).scaled(r1);
        row[1] = length * across;
        for (row, drawn) in row[2..].iter_mut().zip(&self.drawn) {
            *row = along * *drawn;
        }
        let along1 = normal[0] * configuration.e1[0] + normal[1] * configuration.e1[1];
        -(along1 * rate1 * rate1).scaled(r1)
            + along * (length_tt - length * rate2 * rate2)
            + across * (length_t + length_t) * rate2
    }
}

/// What [`BentArm`] finds.
#[derive(Clone, Copy, Debug)]
pub struct Accelerations<T> {
    /// Of (theta10, theta20), rad/s^2.
    pub angle: [T; 2],
    /// Contact force along the normal, N.
    pub force: T,
}

/// Factors a symmetric positive definite matrix of `size` rows, lower triangle row by row, into
/// `L D L'`: L below the diagonal, the reciprocals of D on it.
fn factor<T: Real>(a: &mut [T], size: usize) {
    for i in 0..size {
        let (before, line) = a.split_at_mut(row(i));
        let line = &mut line[..=i];
        // line := D L' of this row.
        for j in 0..i {
            let other = &before[row(j)..][..j];
            let sum = other
                .iter()
                .zip(&line[..j])
                .fold(T::ZERO, |sum, (l, x)| sum + *l * *x);
            line[j] -= sum;
        }
        let mut pivot = line[i];
        for j in 0..i {
            let scaled = line[j];
            line[j] = scaled * before[row(j) + j];
            pivot -= scaled * line[j];
        }
        line[i] = T::ONE / pivot;
    }
}

/// Solves with a factor of [`factor`].
fn solve<T: Real>(factor: &[T], x: &mut [T]) {
    let size = x.len();
    for i in 0..size {
        let line = &factor[row(i)..][..i];
        let sum = line
            .iter()
            .zip(&x[..i])
            .fold(T::ZERO, |sum, (l, x)| sum + *l * *x);
        x[i] -= sum;
    }
    for (i, x) in x.iter_mut().enumerate() {
        *x = *x * factor[row(i) + i];
    }
    for i in (0..size).rev() {
        let (below, value) = (&factor[row(i)..][..i], x[i]);
        for (x, l) in x[..i].iter_mut().zip(below) {
            *x -= *l * value;
        }
    }
}
