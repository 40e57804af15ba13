//! Where the arm rests, in the air or with its tip pressing: the link's shape by Newton's method.

use crate::model::arm_model::ArmModel;
use crate::model::bending::Given;
use crate::model::dual::Dual;
use crate::model::servo::{Reference, Servo};
use crate::model::unknowns::{LANES, SECTION_SINE_MAX, Seeded, admits, steepest_sine, units_of};
use flexor::model::JointMotion;
use nalgebra::{DMatrix, DVector};

/// Why no rest was found from where it was looked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Unrest {
    /// The equations have no value at the shape that was come to.
    Undefined,
    /// A section stands too steeply.
    Steep,
    /// The equations are singular, or the search came to no end.
    Buckled,
}

/// The arm at rest.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Rest {
    /// (theta10, theta20), rad.
    pub(crate) angle: [f64; 2],
    /// Length of link 2's chord, m.
    pub(crate) chord_m: f64,
    /// Angle of the root's tangent against the chord, rad.
    pub(crate) root_slope_rad: f64,
    /// Nodal unknowns of link 2.
    pub(crate) nodal: Vec<f64>,
    /// Torques that hold it, N m.
    pub(crate) torque: [f64; 2],
}

/// `model`'s arm at rest where `reference` prescribes it (of which rates and accelerations count as
/// zero), its tip pressing with `force`, N, inertial axes.
///
/// # Errors
/// [`Unrest`].
pub(crate) fn rest(
    model: &ArmModel,
    reference: &Reference,
    force: [f64; 2],
) -> Result<Rest, Unrest> {
    let n = model.dof();
    let zeros = vec![0.0; n];
    let reference = match reference {
        Reference::Tip([position, ..]) => Reference::Tip([*position, [0.0; 2], [0.0; 2]]),
        Reference::Joints(joint) => Reference::Joints(JointMotion {
            angle: joint.angle,
            ..JointMotion::default()
        }),
    };
    let reference = reference.resolved(model).map_err(|_| Unrest::Undefined)?;
    let units = units_of(model);
    let with_units = |q: &[f64]| -> Vec<f64> {
        let both = units.iter().zip(q);
        both.map(|(unit, q)| unit * q).collect()
    };
    let linearise = |q: &[f64]| {
        let w = with_units(q);
        let mut value = vec![f64::NAN; n];
        let mut by_q = DMatrix::zeros(n, n);
        let mut servo = Servo::<Dual<LANES>>::new(model);
        for from in (0..n).step_by(LANES) {
            let nodal = Seeded::<LANES> {
                values: [&w, &zeros, &zeros],
                from,
            };
            if servo.follow(model, &reference, force, &nodal).is_err() {
                break;
            }
            for (i, row) in servo.residual().iter().enumerate() {
                value[i] = row.value();
                for (j, slope) in (from..n).zip(row.slopes()) {
                    by_q[(i, j)] = units[j] * *slope;
                }
            }
        }
        (value, by_q)
    };
    let found = relaxed(vec![0.0; n], linearise, |q| admits(model, q));
    let w = with_units(&found.map_err(|(why, _)| why)?);
    let nodal = Given([&w[..], &zeros, &zeros]);
    let at = Servo::<f64>::new(model).follow(model, &reference, force, &nodal);
    let at = at.map_err(|_| Unrest::Undefined)?;
    Ok(Rest {
        angle: at.joint.angle,
        chord_m: at.chord[0],
        root_slope_rad: at.root.angle[0],
        nodal: w,
        torque: at.torque,
    })
}

/// The zero near `q` of equations of which `linearise` gives the value and the derivative, not leaving what
/// `admits` admits.
///
/// # Errors
/// [`Unrest`], with `q` as far as it came.
pub(crate) fn relaxed(
    mut q: Vec<f64>,
    linearise: impl Fn(&[f64]) -> (Vec<f64>, DMatrix<f64>),
    admits: impl Fn(&[f64]) -> bool,
) -> Result<Vec<f64>, (Unrest, Vec<f64>)> {
    /// Convergence is quadratic: from a straight link five suffice.
    const STEPS_MAX: usize = 40;
    /// A rounding of the shape, rad and share of the length.
    const SMALL: f64 = 1e-13;
    let mut before = f64::INFINITY;
    for _ in 0..STEPS_MAX {
        let (value, by_q) = linearise(&q);
        let mut step = DVector::from_vec(value);
        if !step.iter().all(|x| x.is_finite()) {
            return Err((Unrest::Undefined, q));
        }
        if !by_q.lu().solve_mut(&mut step) {
            return Err((Unrest::Buckled, q));
        }
        let mut share = 1.0;
        let stepped = |share: f64| -> Vec<f64> {
            let both = q.iter().zip(&step);
            both.map(|(q, step)| q - share * step).collect()
        };
        while share > 1e-3 && !admits(&stepped(share)) {
            share *= 0.5;
        }
        q = stepped(share);
        let size = step.amax();
        if share == 1.0 && (size <= SMALL || (size < 1e-9 && size >= 0.5 * before)) {
            return Ok(q);
        }
        before = size;
    }
    let buckled = admits(&q) && steepest_sine(&q) < 0.9 * SECTION_SINE_MAX;
    let why = if buckled {
        Unrest::Buckled
    } else {
        Unrest::Steep
    };
    Err((why, q))
}
