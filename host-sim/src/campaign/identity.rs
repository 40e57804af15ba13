//! What a campaign is: everything that its runs' results depend on, as the file beside them says.

use crate::text::quoted;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use std::fmt;
use std::str::FromStr;

/// A file that a campaign was made of, as it was read.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CampaignInput {
    /// The option that names it, without hyphens: `scenario`, `controller`, ...
    pub option: String,
    /// What the command line said: the file, as it was named, or a value. Empty where it said
    /// nothing, and the scenario names the file or it is built in.
    pub file: String,
    /// Its text. Kept whole, so that results say what they are results of, and two campaigns
    /// can be told apart without doubt.
    pub text: String,
    /// SHA-256 of the file's bytes, in hex; empty for a value.
    #[serde(default)]
    pub sha256: String,
}

/// A part of a campaign's runs: those whose number leaves the remainder `number` - 1 when divided
/// by `of`, so that every shard has as much to do.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Shard {
    number: u64,
    of: u64,
}

impl Shard {
    /// The whole campaign.
    pub const ALL: Self = Self { number: 1, of: 1 };

    /// True for the runs of this shard.
    pub fn holds(self, run: u64) -> bool {
        run % self.of == self.number - 1
    }

    /// The numbers of this shard's runs in a campaign of `runs`, rising.
    pub fn runs(self, runs: u64) -> impl Iterator<Item = u64> {
        (self.number - 1..runs).step_by(usize::try_from(self.of).unwrap_or(usize::MAX))
    }
}

/// Why a text names no shard.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "{text:?} is no shard: a number from 1 and how many shards there are, e.g. 3/8, are accepted"
)]
pub struct ShardError {
    text: String,
}

impl FromStr for Shard {
    type Err = ShardError;

    /// # Errors
    /// [`ShardError`], which shows the text.
    fn from_str(text: &str) -> Result<Self, ShardError> {
        let numbers = text.split_once('/');
        let numbers = numbers.and_then(|(a, b)| Some((a.parse().ok()?, b.parse().ok()?)));
        match numbers {
            Some((number, of)) if 1 <= number && number <= of => Ok(Self { number, of }),
            _ => Err(ShardError {
                text: crate::text::one_line(text, 40),
            }),
        }
    }
}

impl TryFrom<String> for Shard {
    type Error = ShardError;

    fn try_from(text: String) -> Result<Self, ShardError> {
        text.parse()
    }
}

impl From<Shard> for String {
    fn from(shard: Shard) -> Self {
        shard.to_string()
    }
}

impl fmt::Display for Shard {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.number, self.of)
    }
}

/// Everything that a campaign's results depend on; `campaign.json` beside them.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CampaignIdentity {
    /// Version of the keys.
    #[serde(default)]
    pub schema_version: u32,
    /// Version of the program.
    pub version: String,
    /// Commit that it was built from; `unknown` outside a repository, and in files from before it
    /// was said.
    #[serde(default = "unknown")]
    pub commit: String,
    /// The campaign's seed.
    pub seed: u64,
    /// Runs of the campaign, all shards together.
    pub runs: u64,
    /// Which of them these are.
    pub shard: Shard,
    /// The files given, in the order of the options.
    pub inputs: Vec<CampaignInput>,
    /// The hybrid law's gains and what they were proved to bear, as the summary says it; follows from
    /// the inputs.
    #[serde(default, skip_serializing_if = "Map::is_empty")]
    pub gains: Map<String, Value>,
}

/// What a commit is called that nobody knows.
fn unknown() -> String {
    "unknown".into()
}

impl CampaignIdentity {
    /// The command line that makes the whole campaign, or repeats one run of it.
    pub fn command(&self, only: Option<u64>) -> String {
        let inputs = self.inputs.iter();
        let options: String = inputs
            .filter(|input| !input.file.is_empty())
            .map(|input| format!(" --{} {}", input.option, quoted(&input.file)))
            .collect();
        let Self { runs, seed, .. } = self;
        let only = only.map_or(String::new(), |run| format!(" --only {run}"));
        format!("flexor campaign{options} --runs {runs} --seed {seed}{only}")
    }

    /// The first thing in which `other` is another campaign, shards apart; `None` if it is the
    /// same. Names of files may differ, their texts may not.
    pub fn difference(&self, other: &Self) -> Option<String> {
        if self.version != other.version {
            return Some(format!("version {} and {}", self.version, other.version));
        }
        if self.commit != other.commit {
            return Some(format!(
                "made by programs of commit {} and {}",
                self.commit, other.commit
            ));
        }
        if self.seed != other.seed {
            return Some(format!("seed {} and {}", self.seed, other.seed));
        }
        if self.runs != other.runs {
            return Some(format!("{} and {} runs", self.runs, other.runs));
        }
        let differing = |a: &CampaignIdentity, b: &CampaignIdentity| {
            let same =
                |x: &CampaignInput, y: &CampaignInput| x.option == y.option && x.text == y.text;
            let mut inputs = a.inputs.iter();
            inputs
                .find(|x| !b.inputs.iter().any(|y| same(x, y)))
                .map(|input| format!("other texts of --{}", input.option))
        };
        differing(self, other).or_else(|| differing(other, self))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_run_is_in_one_shard() {
        let shards = ["1/3", "2/3", "3/3"].map(|text| text.parse::<Shard>().unwrap());
        for run in 0..20 {
            assert_eq!(shards.iter().filter(|shard| shard.holds(run)).count(), 1);
        }
        for shard in shards {
            let listed: Vec<u64> = shard.runs(20).collect();
            let held: Vec<u64> = (0..20).filter(|run| shard.holds(*run)).collect();
            assert_eq!(listed, held);
        }
        assert_eq!(Shard::ALL.runs(3).collect::<Vec<_>>(), [0, 1, 2]);
        assert_eq!("8/8".parse::<Shard>().unwrap().runs(3).count(), 0);
    }

    #[test]
    fn a_text_that_is_no_shard_is_refused() {
        for text in ["0/3", "4/3", "1", "1/", "a/b", "-1/3", "1/3/5", "", "1/0"] {
            let error = text.parse::<Shard>().unwrap_err().to_string();
            assert!(
                error.starts_with(&format!("{text:?} is no shard")),
                "{error}"
            );
        }
    }

    fn identity() -> CampaignIdentity {
        let input = |option: &str, text: &str| CampaignInput {
            option: option.into(),
            file: format!("{option}.toml"),
            text: text.into(),
            sha256: String::new(),
        };
        CampaignIdentity {
            schema_version: 1,
            version: "0.1.0".into(),
            commit: "0123abcd".into(),
            seed: u64::MAX,
            runs: 200,
            shard: "2/8".parse().unwrap(),
            inputs: vec![input("scenario", "a = 1\n"), input("controller", "")],
            gains: Map::new(),
        }
    }

    #[test]
    fn an_identity_comes_back_from_its_json() {
        let text = serde_json::to_string(&identity()).unwrap();
        assert!(text.contains(r#""shard":"2/8""#), "{text}");
        assert_eq!(
            serde_json::from_str::<CampaignIdentity>(&text).unwrap(),
            identity()
        );
        assert!(serde_json::from_str::<CampaignIdentity>(&text.replace("2/8", "9/8")).is_err());
    }

    #[test]
    fn campaigns_differ_in_what_their_runs_depend_on() {
        let one = identity();
        let changed = |change: &dyn Fn(&mut CampaignIdentity)| {
            let mut other = identity();
            change(&mut other);
            let there = one.difference(&other);
            assert_eq!(there.is_some(), other.difference(&one).is_some());
            there
        };
        assert_eq!(changed(&|_| {}), None);
        assert_eq!(changed(&|other| other.shard = Shard::ALL), None);
        assert_eq!(
            changed(&|other| other.inputs[0].file = "elsewhere".into()),
            None
        );
        assert_eq!(
            changed(&|other| other.seed = 1),
            Some(format!("seed {} and 1", u64::MAX))
        );
        assert_eq!(
            changed(&|other| other.runs = 9),
            Some("200 and 9 runs".into())
        );
        assert!(changed(&|other| other.version = "1".into()).is_some());
        assert_eq!(
            changed(&|other| other.commit = "unknown".into()),
            Some("made by programs of commit 0123abcd and unknown".into())
        );
        assert_eq!(
            changed(&|other| other.inputs[0].text.push(' ')),
            Some("other texts of --scenario".into())
        );
        assert_eq!(
            changed(&|other| drop(other.inputs.pop())),
            Some("other texts of --controller".into())
        );
    }
}
