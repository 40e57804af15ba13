//! What each field of the user's files accepts: the one list of ranges, and words for what is no
//! number.

use crate::model::arm_model::ELEMENTS_MAX;
use crate::plant::SUBSTEPS_MAX;
use crate::text::Shortest;
use std::fmt;

/// The numbers that a field accepts.
pub(super) struct Range {
    /// Dotted name of the field.
    pub(super) field: &'static str,
    /// Smallest value; excluded where `above`.
    low: f64,
    above: bool,
    high: f64,
    /// Words for what the numbers are, with the unit.
    what: &'static str,
}

/// Values from `low` to `high`.
const fn from(field: &'static str, low: f64, high: f64, what: &'static str) -> Range {
    Range {
        field,
        low,
        above: false,
        high,
        what,
    }
}

/// Values above `low`, up to `high`.
const fn above(field: &'static str, low: f64, high: f64, what: &'static str) -> Range {
    Range {
        field,
        low,
        above: true,
        high,
        what,
    }
}

impl Range {
    /// False for NaN too.
    pub(super) fn holds(&self, value: f64) -> bool {
        let low = if self.above {
            value > self.low
        } else {
            value >= self.low
        };
        low && value <= self.high
    }
}

impl fmt::Display for Range {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (low, high, what) = (Shortest(self.low), Shortest(self.high), self.what);
        if self.above {
            write!(f, "{what} above {low} up to {high}")
        } else {
            write!(f, "{what} from {low} to {high}")
        }
    }
}

/// Wide enough for any arm that this model describes, and no wider: beyond, a value is
/// a slip of the unit.
pub(super) const RANGES: &[Range] = &[
    from("link1.length_m", 1e-3, 100.0, "a length in m"),
    from("link1.mass_kg", 1e-6, 1e5, "a mass in kg"),
    from("link2.length_m", 1e-3, 100.0, "a length in m"),
    from("link2.mass_kg", 1e-6, 1e5, "a mass in kg"),
    from(
        "link2.bending_stiffness_Nm2",
        1e-9,
        1e9,
        "a stiffness EI in N m^2",
    ),
    from("link2.damping_ratio", 0.0, 0.99, "a ratio"),
    // The planner's zeros become the harder the finer the link; see docs/model.md.
    from("link2.elements", 1.0, 12.0, "a whole number of elements"),
    from("link2.bending_damping_s", 0.0, 10.0, "a time in s"),
    from("link2.root_inertia_kgm2", 0.0, 1e3, "an inertia in kg m^2"),
    from("link2.tip_mass_kg", 0.0, 1e5, "a mass in kg"),
    from("link2.tip_inertia_kgm2", 0.0, 1e3, "an inertia in kg m^2"),
    from("base.gravity_m_s2", -1e3, 1e3, "two accelerations in m/s^2"),
    above("limits.torque_Nm", 0.0, 1e6, "two torques in N m"),
    above(
        "limits.torque_rate_Nm_s",
        0.0,
        1e12,
        "two torque rates in N m/s",
    ),
    from("duration_s", 1e-4, 1000.0, "a time in s"),
    from("pre_actuation_s", 0.0, 60.0, "\"auto\" or a time in s"),
    from("post_actuation_s", 0.0, 60.0, "\"auto\" or a time in s"),
    from("actuation_tolerance", 1e-15, 0.5, "a ratio"),
    from("path.from_m", -200.0, 200.0, "two coordinates in m"),
    from("path.to_m", -200.0, 200.0, "two coordinates in m"),
    from("move.from_rad", -20.0, 20.0, "two joint angles in rad"),
    from("move.to_rad", -20.0, 20.0, "two joint angles in rad"),
    from(
        "move.from_motor_rad",
        -20.0,
        20.0,
        "two motor angles in rad",
    ),
    from("move.to_motor_rad", -20.0, 20.0, "two motor angles in rad"),
    from("move.clearance_m", 0.0, 100.0, "a length in m"),
    from("force.normal_N", 0.0, 1e6, "a force in N"),
    from(
        "force.direction",
        -1e6,
        1e6,
        "two components, not both zero,",
    ),
    from("surface.friction", 0.0, 10.0, "a friction coefficient"),
    above("surface.friction_way_m", 0.0, 1.0, "a way in m"),
    from("bending_damping_s", 0.0, 10.0, "a time in s"),
    from("K_DF_s", 0.0, 1e3, "a gain in s"),
    from("K_PF", 0.0, 1e3, "a gain"),
    from("K_IF_per_s", 0.0, 1e6, "a gain in 1/s"),
    from("K_w_Nms_rad", 0.0, 1e4, "a gain in N m s/rad"),
    above("force_filter_Hz", 0.0, 1e6, "a frequency in Hz"),
    above("slope_rate_filter_Hz", 0.0, 1e6, "a frequency in Hz"),
    from(
        "joint_stiffness_Nm_rad",
        0.0,
        1e10,
        "two stiffnesses in N m/rad",
    ),
    from(
        "joint_damping_Nms_rad",
        0.0,
        1e9,
        "two dampings in N m s/rad",
    ),
    above("rate_filter_Hz", 0.0, 1e6, "two frequencies in Hz"),
    from(
        "joint1_integral_Nm_rads",
        0.0,
        1e11,
        "a gain in N m/(rad s), 0 where joint_stiffness_Nm_rad[0] is,",
    ),
    from("joint1_integral_limit_Nm", 0.0, 1e9, "a torque in N m"),
    from("force_integral_per_s", 0.0, 1e3, "a gain in 1/s"),
    from("torque_loop_per_s", 0.0, 1e4, "a gain in 1/s"),
    from("torque_correction_limit_Nm", 0.0, 1e9, "a torque in N m"),
    from("section_frequency_rad_s", 0.0, 1e4, "a frequency in rad/s"),
    from("section_damping", 0.0, 1.0, "a damping ratio"),
    from("section_angle_Nm_rad", -1e9, 1e9, "two gains in N m/rad"),
    from("section_force", -1e3, 1e3, "two gains"),
    from("free.stiffness_Nm_rad", 0.0, 1e10, "a stiffness in N m/rad"),
    from("free.damping_Nms_rad", 0.0, 1e9, "a damping in N m s/rad"),
    from("free.torque_loop_per_s", 0.0, 1e4, "a gain in 1/s"),
    from(
        "free.section_frequency_rad_s",
        0.0,
        1e4,
        "a frequency in rad/s",
    ),
    from("free.section_damping", 0.0, 1.0, "a damping ratio"),
    from(
        "free.section_angle_Nm_rad",
        -1e9,
        1e9,
        "two gains in N m/rad",
    ),
    from("motion.settle_s", 0.0, 60.0, "a time in s"),
    above("motion.approach_speed_m_s", 0.0, 1.0, "a speed in m/s"),
    above("motion.approach_limit_m", 0.0, 10.0, "a way in m"),
    above("motion.contact_on_share", 0.0, 0.9, "a share"),
    above("motion.contact_off_share", 0.0, 0.9, "a share"),
    above("motion.force_ramp_per_s", 0.0, 1e3, "a rate in 1/s"),
    above("motion.lost_s", 0.0, 10.0, "a time in s"),
    above("motion.stop_s", 0.0, 10.0, "a time in s"),
    above("motion.lift_speed_m_s", 0.0, 1.0, "a speed in m/s"),
    from("motion.lift_m", 0.0, 1.0, "a way in m"),
    from(
        "elements",
        1.0,
        ELEMENTS_MAX as f64,
        "a whole number of elements",
    ),
    from("bending_stiffness_scale", 0.01, 100.0, "a factor"),
    from("link1_mass_scale", 0.01, 100.0, "a factor"),
    from("link2_mass_scale", 0.01, 100.0, "a factor"),
    from("damping_scale", 0.0, 10.0, "a factor"),
    from("root_inertia_kgm2", 0.0, 1e3, "an inertia in kg m^2"),
    from("tip_mass_kg", 0.0, 1e5, "a mass in kg"),
    from("tip_inertia_kgm2", 0.0, 1e3, "an inertia in kg m^2"),
    from("added_root_inertia_kgm2", 0.0, 1e3, "inertias in kg m^2"),
    from("contact_angle_rad", -1.0, 1.0, "angles in rad"),
    from("tick_rate_Hz", 10.0, 1e6, "control rates in Hz"),
    from(
        "viscous_friction_Nms_rad",
        0.0,
        1e4,
        "two frictions in N m s/rad",
    ),
    from(
        "coulomb_friction_Nm",
        0.0,
        1e4,
        "two friction torques in N m",
    ),
    from(
        "substeps",
        1.0,
        SUBSTEPS_MAX as f64,
        "a whole number of integration steps a tick",
    ),
    from("encoders.lines", 1.0, 1e6, "two whole numbers of lines"),
    from(
        "encoders.gear_ratio",
        1e-3,
        1e4,
        "two numbers of motor turns a joint turn",
    ),
    from("encoders.home_rad", -10.0, 10.0, "two angles in rad"),
    from(
        "force_cell.range_N",
        -1e6,
        1e6,
        "two forces in N, one below and one above 0,",
    ),
    from(
        "root_gauge.range_rad",
        -1e3,
        1e3,
        "two slopes in rad, one below and one above 0,",
    ),
    // Counts of the sensors have 16 bits.
    from("converter.bits", 8.0, 16.0, "a whole number of bits"),
    from(
        "converter.rail_counts",
        0.0,
        16_384.0,
        "a whole number of counts",
    ),
    from("drives.full_scale_Nm", 1e-9, 1e6, "two torques in N m"),
    from("drives.bits", 8.0, 16.0, "a whole number of bits"),
    from("drives.usable_share", 0.01, 1.0, "a share"),
    from("enabling.angle_rad", 0.0, 3.2, "two angles in rad"),
    from("enabling.slope_rad", 0.0, 3.2, "a slope in rad"),
    from("enabling.motor_rad", 0.0, 3.2, "two angles in rad"),
    from("enabling.soft_start_s", 0.0, 2.0, "a time in s"),
    from("link.timeout_s", 0.01, 10.0, "a time in s"),
];

/// Words for what the fields without a range accept.
const WORDS: &[(&str, &str)] = &[
    (
        "name",
        "a word of up to 32 small letters, digits and underscores",
    ),
    ("encoders", "a table [encoders]"),
    ("encoders.sign", "1 or -1 for either joint"),
    ("force_cell", "a table [force_cell]"),
    ("root_gauge", "a table [root_gauge]"),
    ("converter", "a table [converter]"),
    ("drives", "a table [drives]"),
    ("drives.sign", "1 or -1 for either joint"),
    ("enabling", "a table [enabling]"),
    ("link", "a table [link]"),
    ("link1", "a table [link1]"),
    ("link2", "a table [link2]"),
    ("link2.model", "\"linear\" or \"geometric\""),
    ("link2.damping", "\"modal\" or \"bending\""),
    ("model", "\"linear\" or \"geometric\""),
    ("damping", "\"modal\" or \"bending\""),
    ("base", "a table [base]"),
    ("base.elbow", "\"down\" or \"up\""),
    ("limits", "a table [limits]"),
    ("ends", "\"spectral\" or \"dirichlet\""),
    ("path", "a table [path]"),
    ("path.profile", "\"poly11\""),
    ("force", "a table [force]"),
    (
        "force.profile_m_N",
        "way-points [place in m from the path's start, force in N]",
    ),
    ("force.profile_csv", "a file of lines s_m,force_N"),
    ("surface", "a table [surface]"),
    ("free", "a table [free]"),
    ("motion", "a table [motion]"),
    ("law", "\"paper\" or \"hybrid\""),
    (
        "force_projection",
        "\"jacobian-transpose\" or \"as-printed\"",
    ),
    ("slope_rate_feedback", "\"deviation\" or \"as-printed\""),
    ("feedforward", "true or false"),
    ("geometric_stiffness", "\"none\", \"contact\" or \"full\""),
    (
        "start",
        "\"plan-moving\", \"plan-at-rest\" or \"equilibrium\"",
    ),
];

/// What `field` accepts, in words.
pub(super) fn accepted(field: &str) -> Option<String> {
    let range = RANGES.iter().find(|r| r.field == field);
    let words = || WORDS.iter().find(|(name, _)| *name == field);
    range
        .map(ToString::to_string)
        .or_else(|| words().map(|(_, words)| (*words).to_string()))
}
