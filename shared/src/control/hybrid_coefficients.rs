//! What the hybrid law's coefficients are after rounding, for checks on the host.

use crate::control::feedback::Coefficient;
use crate::control::filter::filter_alpha;
use crate::control::hybrid::{HybridLaw, Joint2};
use crate::control::hybrid_parameters::{FreeParameters, HybridParameters};
use crate::model::ArmParameters;
use crate::number::SiScalar;
use crate::signals::Formats;

/// Keys of joint 2's coefficients, in contact and in the air. What a section keeps of its states
/// comes from its frequency, and what they take of each other from its damping.
const CONTACT: [&str; 7] = [
    "joint_stiffness_Nm_rad[1]",
    "joint_damping_Nms_rad[1]",
    "torque_loop_per_s",
    "section_angle_Nm_rad[0]",
    "section_angle_Nm_rad[1]",
    "section_frequency_rad_s",
    "section_damping",
];
const FREE: [&str; 7] = [
    "free.stiffness_Nm_rad",
    "free.damping_Nms_rad",
    "free.torque_loop_per_s",
    "free.section_angle_Nm_rad[0]",
    "free.section_angle_Nm_rad[1]",
    "free.section_frequency_rad_s",
    "free.section_damping",
];

fn coefficient((name, wanted, is): (&'static str, f64, f64)) -> Coefficient {
    Coefficient { name, wanted, is }
}

impl<T: SiScalar> HybridLaw<T> {
    /// The coefficients after rounding, beside what they were made from.
    pub fn coefficients(
        &self,
        parameters: &HybridParameters,
        arm: &ArmParameters,
        tick_rate_hz: u32,
        formats: &Formats<T::Format>,
    ) -> impl Iterator<Item = Coefficient> {
        let p = parameters.sent();
        let rate = f64::from(tick_rate_hz);
        let [torque1, torque2] = formats.torque;
        let [contact, free] = [
            (&self.contact, p.contact(), CONTACT),
            (&self.free, p.free, FREE),
        ]
        .map(|(joint, p, names)| self.of_joint2(joint, &p, names, (rate, torque2)));
        let length = |gain| T::gain_value(gain, T::SINE, formats.moment_arm);
        let [stiffness, _] = p.joint_stiffness_nm_rad;
        let [damping, _] = p.joint_damping_nms_rad;
        let [filter1, filter2] = p.rate_filter_hz.map(|hz| filter_alpha(hz, rate));
        let section = p.section_frequency_rad_s / rate;
        let force = [0, 1].map(|i| T::gain_value(self.contact.section_force[i], torque2, torque2));
        let own = [
            (
                "link1.length_m",
                arm.link1_length_m,
                length(self.link_length[0]),
            ),
            (
                "link2.length_m",
                arm.link2_length_m,
                length(self.link_length[1]),
            ),
            (
                "joint_stiffness_Nm_rad[0]",
                stiffness,
                T::angle_gain_value(self.stiffness, torque1),
            ),
            (
                "joint_damping_Nms_rad[0]",
                damping,
                T::fine_gain_value(self.damping, self.fine, torque1) / rate,
            ),
            (
                "rate_filter_Hz[0]",
                filter1,
                T::alpha_value(self.rate_filter[0]),
            ),
            (
                "rate_filter_Hz[1]",
                filter2,
                T::alpha_value(self.rate_filter[1]),
            ),
            (
                "joint1_integral_Nm_rads",
                p.joint1_integral_nm_rads,
                T::alpha_value(self.place_integral) * rate * stiffness,
            ),
            (
                "force_integral_per_s",
                p.force_integral_per_s,
                T::alpha_value(self.contact.force_integral) * rate,
            ),
            ("section_force[0]", section * p.section_force[0], force[0]),
            ("section_force[1]", section * p.section_force[1], force[1]),
        ];
        own.into_iter().chain(contact).chain(free).map(coefficient)
    }

    /// Joint 2's, under these names.
    fn of_joint2(
        &self,
        joint: &Joint2<T>,
        p: &FreeParameters,
        names: [&'static str; 7],
        (rate, torque): (f64, T::Format),
    ) -> [(&'static str, f64, f64); 7] {
        let section = p.section_frequency_rad_s / rate;
        let [g1, g2] = p.section_angle_nm_rad;
        let [keeps, takes] = p.rotation(rate);
        let [angle1, angle2] = joint
            .section_angle
            .map(|gain| T::angle_gain_value(gain, torque));
        let pairs = [
            (
                p.stiffness_nm_rad,
                T::angle_gain_value(joint.stiffness, torque),
            ),
            (
                p.damping_nms_rad * rate,
                T::fine_gain_value(joint.damping, self.fine, torque),
            ),
            (
                p.torque_loop_per_s,
                T::alpha_value(joint.torque_loop) * rate,
            ),
            (section * g1, angle1),
            (section * g2, angle2),
            (keeps, T::alpha_value(joint.rotation[0])),
            (takes, T::alpha_value(joint.rotation[1])),
        ];
        let mut pairs = pairs.into_iter();
        names.map(|name| {
            let (wanted, is) = pairs.next().unwrap_or_default();
            (name, wanted, is)
        })
    }
}
