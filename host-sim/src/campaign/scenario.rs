//! A scenario: what arms a bench has, with their spreads and faults, and what is asked of them.

use crate::campaign::distribution::Distribution;
use crate::campaign::keys::Key;
use crate::campaign::setup::BenchSetup;
use crate::campaign::verdict::Limits as VerdictLimits;
use crate::model::geometric_stiffness::GeometricStiffness;
use crate::model::link::LinkModel;
use crate::plant::bench::{GaugeSignal, RandomStream, SurfaceFeature};
use crate::simulation::bench::{FailureLimits, TimedFault};
use flexor::control::LawParameters;

/// A scenario, checked.
#[derive(Clone, Debug, Default)]
pub struct Scenario {
    /// Its numbers, fixed or spread.
    pub numbers: Vec<(&'static Key, Distribution)>,
    /// Axial forces that change the bending stiffness.
    pub geometric_stiffness: GeometricStiffness,
    /// How link 2 bends; `None` for as it was planned.
    pub link_model: Option<LinkModel>,
    /// What the root gauge shows; `None` for the moment, as a gauge does, or what
    /// [`for_law`](Self::for_law) makes of it.
    pub gauge_signal: Option<GaugeSignal>,
    /// Steps, holes and ends of the surface.
    pub features: Vec<SurfaceFeature>,
    /// What goes wrong, and when.
    pub faults: Vec<TimedFault>,
    /// From which error on a run counts as failed.
    pub failure: FailureLimits,
    /// What is asked of a campaign.
    pub verdict: VerdictLimits,
}

/// Streams of random numbers are numbered; those of drawn values begin here, after all of the
/// bench's own.
const FIRST_STREAM: u64 = 1000;

impl Scenario {
    /// Names of the numbers that are spread, in order.
    pub fn spread_keys(&self) -> impl Iterator<Item = &'static str> {
        self.numbers
            .iter()
            .filter(|(_, distribution)| distribution.is_spread())
            .map(|(key, _)| key.name)
    }

    /// Where nothing is said of what the root gauge shows: for this law what it asks for, the moment
    /// for the hybrid law and the slope, which no gauge shows, for the paper's.
    pub fn for_law(&mut self, law: &LawParameters) {
        self.gauge_signal.get_or_insert(match law {
            LawParameters::Paper(_) => GaugeSignal::Slope,
            LawParameters::Hybrid(_) => GaugeSignal::Moment,
        });
    }

    /// The arm in the middle of every spread.
    pub fn middle(&self) -> BenchSetup {
        self.with(|_, distribution| distribution.middle()).0
    }

    /// The arm that `seed` draws, and its drawn values in the order of
    /// [`spread_keys`](Self::spread_keys).
    ///
    /// Every number has random numbers of its own, by its name: a spread more or less leaves the
    /// others' values as they were.
    pub fn draw(&self, seed: u64) -> (BenchSetup, Vec<f64>) {
        self.with(|key, distribution| {
            let stream = FIRST_STREAM + name_hash(key.name);
            distribution.draw(&mut RandomStream::new(seed, stream))
        })
    }

    /// The arm whose numbers are `value`, and those that are spread.
    fn with(&self, value: impl Fn(&Key, &Distribution) -> f64) -> (BenchSetup, Vec<f64>) {
        let mut setup = BenchSetup::default();
        setup.plant.geometric_stiffness = self.geometric_stiffness;
        setup.plant.link_model = self.link_model;
        setup.compliant.surface.features.clone_from(&self.features);
        setup.faults.clone_from(&self.faults);
        if let Some(signal) = self.gauge_signal {
            setup.sensors.gauge_signal = signal;
        }
        let mut drawn = Vec::new();
        for (key, distribution) in &self.numbers {
            let value = value(key, distribution);
            key.set(&mut setup, value);
            if distribution.is_spread() {
                drawn.push(value);
            }
        }
        (setup, drawn)
    }
}

/// The seed of run `run` in a campaign with `seed`.
pub fn run_seed(seed: u64, run: u64) -> u64 {
    // SplitMix64's finaliser, so that neighbouring seeds and runs have nothing in common.
    let mut mixed = seed
        .wrapping_mul(0xd134_2543_de82_ef95)
        .wrapping_add(run.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15));
    mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    mixed ^ (mixed >> 31)
}

/// A number for a name (FNV-1a of 32 bits), the same for ever.
fn name_hash(name: &str) -> u64 {
    let hash = name.bytes().fold(0x811c_9dc5_u32, |hash, byte| {
        (hash ^ u32::from(byte)).wrapping_mul(0x0100_0193)
    });
    u64::from(hash)
}

#[cfg(test)]
mod tests {
    use super::*;
    use flexor::control::HybridParameters;

    #[test]
    fn the_gauge_shows_what_the_law_asks_for_unless_the_scenario_says_otherwise() {
        let hybrid = HybridParameters::PAPER_ARM_HUB.into();
        let paper = LawParameters::FEEDFORWARD;
        let shown = |said, law: &LawParameters| {
            let mut scenario = Scenario {
                gauge_signal: said,
                ..Scenario::default()
            };
            scenario.for_law(law);
            let drawn = scenario.draw(1).0;
            assert_eq!(drawn, scenario.middle());
            drawn.sensors.gauge_signal
        };
        assert_eq!(shown(None, &hybrid), GaugeSignal::Moment);
        assert_eq!(shown(None, &paper), GaugeSignal::Slope);
        for said in [GaugeSignal::Moment, GaugeSignal::Slope] {
            assert_eq!(shown(Some(said), &hybrid), said);
            assert_eq!(shown(Some(said), &paper), said);
        }
    }
}
