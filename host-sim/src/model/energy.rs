//! The energy of the arm, whose Lagrange equations the equations of motion are.

use crate::model::arm_model::ArmModel;
use crate::model::bending::{Bent, Given};
use crate::model::configuration::{Configuration, State};
use crate::model::link::LinkModel;

/// Kinetic energy plus elastic and gravitational potential, J, of the arm in `state`. Without the linear
/// model's geometric stiffness, which has no potential in that formulation.
pub fn energy(model: &ArmModel, state: State<'_, f64>) -> f64 {
    let arm = &model.arm;
    let link = &model.link;
    let [w, w_t] = [state.q(), state.q_rate()].map(|q| model.deflection(q));
    let zeros = vec![0.0; model.dof()];
    let bent = Bent::new(link, &Given([w.as_slice(), w_t.as_slice(), &zeros]));
    let configuration = Configuration::new(model, state.angle());
    let Configuration { c, s, g_n, g_e, .. } = configuration;
    let [rate1, rate2] = state.rate();
    let r1 = arm.link1_length_m;
    let squared = |along: [f64; 2], off: [f64; 2]| {
        let across = along[0] * rate2 + off[1] + r1 * rate1 * c;
        let lengthwise = along[1] - off[0] * rate2 + r1 * rate1 * s;
        across * across + lengthwise * lengthwise
    };
    let [length, length_t, _] = bent.chord;
    let turned = |angle_t: f64| (rate2 + angle_t) * (rate2 + angle_t);
    let mut twice_kinetic = model.link1_inertia * rate1 * rate1
        + arm.tip_mass_kg * squared([length, length_t], [0.0, 0.0])
        + arm.root_inertia_kgm2 * turned(bent.root.angle[1])
        + arm.tip_inertia_kgm2 * turned(bent.tip.angle[1]);
    let mut twice_elastic = 0.0;
    let g = arm.gravity_m_s2;
    let [x, y] = configuration.e1;
    let at_joint2 = r1 * (g[0] * x + g[1] * y);
    let mut potential =
        -0.5 * arm.link1_mass_kg * at_joint2 - arm.tip_mass_kg * (at_joint2 + length * g_e);
    for (i, (section, functions)) in bent.sections.iter().zip(&link.sections).enumerate() {
        let point = i % link.points;
        let ([off, off_t, _], [along, along_t, _]) = (section.off, section.along);
        let mass = link.mass[point];
        twice_kinetic += mass * squared([along, along_t], [off, off_t]);
        potential -= mass * (at_joint2 + along * g_e + off * g_n);
        let at = |coefficients: &[f64]| {
            let own = coefficients.iter().zip(&w.as_slice()[functions.first..]);
            own.map(|(c, w)| c * w).sum::<f64>()
        };
        let slope = at(functions.slope());
        let mut curvature = at(functions.curvature());
        if link.kind.model == LinkModel::Geometric {
            curvature /= (1.0 - slope * slope).sqrt();
        }
        twice_elastic += link.bending_stiffness * link.whole[point] * curvature * curvature;
    }
    0.5 * (twice_kinetic + twice_elastic) + potential
}
