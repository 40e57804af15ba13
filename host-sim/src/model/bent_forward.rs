//! Forward dynamics of the arm with a bent link: accelerations from state and torques, in the air, with
//! a given contact force, or with the tip held on a surface. The equations are those of
//! `link_dynamics`.
//!
//! With the generalised coordinates `x = (theta10, theta20, w)` they read
//! `M x'' + h = B tau - J' lambda`. The mass matrix is put together from the velocities of the link's
//! points, along n(theta20) `(r1 c, X, N)` and along e(theta20) `(r1 s, -w, -P)`, where
//! `P = integral of sigma N'` up to the point is how far a change of the unknowns draws it towards
//! joint 2. `h` is what the motion takes without accelerations.

use crate::model::arm_model::{ArmModel, NodalBeam};
use crate::model::bending::{Bent, Given};
use crate::model::configuration::{Configuration, State, Surface};
use crate::model::link::{Link, LinkModel, with_points};
use crate::model::link_dynamics::required_into;
use flexor::model::JointMotion;
use flexor::number::Real;

/// Memory that [`BentArm`] works in, and what it leaves: the arm at an instant.
#[derive(Clone, Debug)]
pub struct BentArm<T> {
    /// Nodal unknowns and their rates.
    nodal: [Vec<T>; 2],
    bent: Bent<T>,
    /// Mass matrix, lower triangle, row by row; then its factor.
    mass: Vec<T>,
    /// `-P` at the beginning of an element; at the end of all, of the tip.
    drawn: Vec<T>,
    /// Sum over all points of their mass times `-P`, kg m; without what is beyond an unknown's last element
    /// until all are known.
    drawn_moment: Vec<T>,
    /// For the factor.
    column: Vec<T>,
    /// `B tau - h`, then the accelerations that it makes.
    acceleration: Vec<T>,
    /// The contact's row J, then the accelerations that a force of 1 N takes away.
    contact: [Vec<T>; 2],
}

/// First moments of the elements up to a place.
struct Moments<T> {
    /// Their mass, kg.
    mass: f64,
    /// Of their points' places along the chord and off it, kg m.
    along: T,
    off: T,
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
            nodal: [(); 2].map(|()| vec![T::ZERO; n]),
            bent: Bent::empty(&model.link),
            mass: vec![T::ZERO; row(size)],
            drawn: vec![T::ZERO; n],
            drawn_moment: vec![T::ZERO; n],
            column: vec![T::ZERO; size],
            acceleration: vec![T::ZERO; size],
            contact: [(); 2].map(|()| vec![T::ZERO; size]),
        }
    }

    /// Takes over the shape of `state`, in modal coordinates.
    fn bend(&mut self, model: &ArmModel, state: State<'_, T>) {
        let [w, w_t] = &mut self.nodal;
        for (nodal, modal) in [(w, state.q()), (w_t, state.q_rate())] {
            nodal.fill(T::ZERO);
            for (shape, q) in model.shapes.column_iter().zip(modal) {
                for (nodal, shape) in nodal.iter_mut().zip(shape.iter()) {
                    *nodal += q.scaled(*shape);
                }
            }
        }
        let [w, w_t] = &self.nodal;
        self.bent.bend(&model.link, &Given([w, w_t]));
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
        factor(&mut self.mass, &mut self.column);
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
        factor(&mut self.mass, &mut self.column);
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
        let [sway, _] = joint2;
        // What does not depend on the shape: link 1, and how the points of link 2 leave the chord.
        self.mass[..row(2)].fill(T::ZERO);
        self.mass[0] = T::from_f64(model.link1_inertia);
        let NodalBeam {
            translating_mass,
            first_moment,
            ..
        } = &model.nodal;
        for i in 0..model.dof() {
            let line = &mut self.mass[row(2 + i)..][..3 + i];
            line[0] = sway.scaled(first_moment[i]);
            line[1] = T::ZERO;
            // Symmetric: columns are rows.
            for (mass, constant) in line[2..].iter_mut().zip(translating_mass.column(i)) {
                *mass = T::from_f64(*constant);
            }
        }
        self.drawn.fill(T::ZERO);
        self.drawn_moment.fill(T::ZERO);
        let mut all = Moments {
            mass: 0.0,
            along: T::ZERO,
            off: T::ZERO,
        };
        with_points!(model.link, POINTS => {
            for element in 0..model.link.elements() {
                self.add_element::<POINTS>(&model.link, element, &mut all);
            }
        });
        self.add_ends(model, joint2, &all);
    }

    /// How far the unknowns of the element whose first point is `begin` draw its points along the chord, `-P`:
    /// what those of them have done before that belong to the element before it, too.
    fn draws<const POINTS: usize>(&self, link: &Link, begin: usize) -> [[T; 4]; POINTS] {
        let (first, count) = (link.sections[begin].first, link.sections[begin].count);
        let mut before = [T::ZERO; 4];
        before[..count].copy_from_slice(&self.drawn[first..first + count]);
        let mut draws = [before; POINTS];
        if link.kind.model == LinkModel::Geometric {
            for (draws, weights) in draws.iter_mut().zip(&link.partial) {
                for (weight, from) in weights[..POINTS].iter().zip(begin..) {
                    let shortening = self.bent.sections[from].shortening.scaled(*weight);
                    for (d, f) in draws.iter_mut().zip(link.sections[from].slope()) {
                        *d -= shortening.scaled(*f);
                    }
                }
            }
        }
        draws
    }

    /// Adds an element, behind `all` before it, with its own unknowns.
    ///
    /// What is beyond an unknown's last element it draws by the same way. So its products with the unknowns
    /// there are this way times their [`drawn_moment`](Self::drawn_moment), and are added at the end, in one go
    /// for all: what is in that sum and no such product is taken off here.
    fn add_element<const POINTS: usize>(
        &mut self,
        link: &Link,
        element: usize,
        all: &mut Moments<T>,
    ) {
        let begin = element * POINTS;
        let (first, count) = (link.sections[begin].first, link.sections[begin].count);
        let draws = self.draws::<POINTS>(link, begin);
        let mut block = [[T::ZERO; 4]; 4];
        let mut turned = [T::ZERO; 4];
        let mut moment = [T::ZERO; 4];
        for (point, draw) in draws.iter().enumerate() {
            let section = &self.bent.sections[begin + point];
            let own = link.sections[begin + point].value();
            let dm = link.mass[point];
            let ([w, ..], [x, ..]) = (section.off, section.along);
            let (dm_w, dm_x) = (w.scaled(dm), x.scaled(dm));
            all.mass += dm;
            all.along += dm_x;
            all.off += dm_w;
            self.mass[2] += x * dm_x + w * dm_w;
            for (i, own) in own.iter().enumerate() {
                let drawn = draw[i].scaled(dm);
                moment[i] += drawn;
                turned[i] += dm_x.scaled(*own) - dm_w * draw[i];
                for j in 0..=i {
                    block[i][j] += drawn * draw[j];
                }
            }
        }
        for (weight, from) in link.whole[..POINTS].iter().zip(begin..) {
            let shortening = self.bent.sections[from].shortening.scaled(*weight);
            for (i, f) in (first..).zip(link.sections[from].slope()) {
                self.drawn[i] -= shortening.scaled(*f);
            }
        }
        // Those of its unknowns that no element after it has.
        let last = element + 1 == link.elements();
        let next = if last { first + count } else { 2 * element + 1 };
        for i in 0..count {
            self.drawn_moment[first + i] += moment[i];
            let moment = self.drawn_moment[first + i];
            let line = &mut self.mass[row(2 + first + i)..][..3 + first + i];
            line[1] += turned[i];
            for j in 0..=i {
                line[2 + first + j] += block[i][j];
                if first + j < next {
                    line[2 + first + j] -= self.drawn[first + j] * moment;
                }
            }
        }
        for i in first..next {
            let drawn = self.drawn[i];
            self.drawn_moment[i] -= drawn.scaled(all.mass);
            self.mass[row(2 + i) + 1] += drawn * all.off;
        }
    }

    /// Adds tip mass, root and tip inertia to the mass matrix, and what unknowns draw beyond their elements.
    fn add_ends(&mut self, model: &ArmModel, [sway, surge]: [T; 2], all: &Moments<T>) {
        let arm = &model.arm;
        let n = self.drawn.len();
        let length = self.bent.chord[0];
        let mass = &mut self.mass;
        let m = arm.tip_mass_kg;
        mass[0] += (sway * sway + surge * surge).scaled(all.mass + m);
        mass[1] += sway * (all.along + length.scaled(m)) - surge * all.off;
        mass[2] += (length * length).scaled(m);
        for i in 0..n {
            let drawn = self.drawn[i];
            let moment = self.drawn_moment[i] + drawn.scaled(all.mass + m);
            let line = &mut mass[row(2 + i)..][..3 + i];
            line[0] += surge * moment;
            line[1] -= drawn * all.off;
            for (mass, drawn) in line[2..].iter_mut().zip(&self.drawn) {
                *mass += moment * *drawn;
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

/// Factors a symmetric positive definite matrix, lower triangle row by row, into
/// `L D L'`: L below the diagonal, the reciprocals of D on it. `column` is memory for as many numbers.
fn factor<T: Real>(a: &mut [T], column: &mut [T]) {
    for j in 0..column.len() {
        let pivot = T::ONE / a[row(j) + j];
        a[row(j) + j] = pivot;
        // D L' of this column, so that what is done with it runs along rows.
        for (i, below) in column.iter_mut().enumerate().skip(j + 1) {
            *below = a[row(i) + j];
        }
        for i in j + 1..column.len() {
            let line = &mut a[row(i) + j..][..=i - j];
            let scaled = line[0] * pivot;
            line[0] = scaled;
            for (x, below) in line[1..].iter_mut().zip(&column[j + 1..]) {
                *x -= scaled * *below;
            }
        }
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
