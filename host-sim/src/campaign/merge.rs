//! The shards of a campaign put together again.

use super::identity::{CampaignIdentity, Shard};
use super::record::CampaignRecords;
use std::collections::BTreeMap;

/// Most stretches of run numbers that a message names.
const STRETCHES_MAX: usize = 8;

/// A shard's results.
#[derive(Clone, Debug, PartialEq)]
pub struct ShardResults {
    /// What messages call it: its folder.
    pub name: String,
    /// Of which campaign it is, and which part.
    pub identity: CampaignIdentity,
    /// Its runs.
    pub records: CampaignRecords,
}

/// Why shards make no campaign.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum MergeError {
    /// There is nothing to merge.
    #[error("no shards: at least one folder of results is accepted")]
    NoShards,
    /// Two shards are of different campaigns.
    #[error("{first} and {second} are of different campaigns: {difference}")]
    OtherCampaign {
        /// The first shard.
        first: String,
        /// The other one.
        second: String,
        /// What differs.
        difference: String,
    },
    /// A run is in two shards.
    #[error("run {run} is both in {first} and in {second}: every run once is accepted")]
    Overlap {
        /// The run's number.
        run: u64,
        /// A shard that has it.
        first: String,
        /// The other one.
        second: String,
    },
    /// A shard has a run that is not its own.
    #[error("{name} has run {run}, which is none of shard {shard} of {runs} runs")]
    OtherShard {
        /// The shard.
        name: String,
        /// The run's number.
        run: u64,
        /// Which part of the campaign it says to be.
        shard: String,
        /// Runs of the campaign.
        runs: u64,
    },
    /// Runs are in no shard.
    #[error("{missing} of {runs} runs are missing: {named}")]
    Missing {
        /// How many.
        missing: u64,
        /// Runs of the campaign.
        runs: u64,
        /// Which, as stretches of numbers.
        named: String,
    },
}

/// Stretches of run numbers, first and last, as text: `3, 17-20 and 45`; of very many the first
/// ones.
fn named(stretches: &[[u64; 2]]) -> String {
    let text = |[first, last]: &[u64; 2]| match first == last {
        true => first.to_string(),
        false => format!("{first}-{last}"),
    };
    let shown = &stretches[..stretches.len().min(STRETCHES_MAX)];
    let mut parts: Vec<String> = shown.iter().map(text).collect();
    if shown.len() < stretches.len() {
        return format!("{}, ...", parts.join(", "));
    }
    let last = parts.pop().unwrap_or_default();
    match parts.is_empty() {
        true => last,
        false => format!("{} and {last}", parts.join(", ")),
    }
}

/// The whole campaign of its shards, in any order: what it would have been without shards.
///
/// # Errors
/// [`MergeError`]: shards of different campaigns, runs that are there twice, are no shard's own,
/// or are missing.
pub fn merge(shards: Vec<ShardResults>) -> Result<(CampaignIdentity, CampaignRecords), MergeError> {
    let first = shards.first().ok_or(MergeError::NoShards)?;
    let identity = CampaignIdentity {
        shard: Shard::ALL,
        ..first.identity.clone()
    };
    let parameters = first.records.parameters.clone();
    // Which shard has the run of this number.
    let mut owner: BTreeMap<u64, usize> = BTreeMap::new();
    for (place, shard) in shards.iter().enumerate() {
        let other = |difference| MergeError::OtherCampaign {
            first: first.name.clone(),
            second: shard.name.clone(),
            difference,
        };
        if let Some(difference) = identity.difference(&shard.identity) {
            return Err(other(difference));
        }
        if shard.records.parameters != parameters {
            return Err(other("other parameters are drawn".into()));
        }
        for record in &shard.records.runs {
            let run = record.run;
            if run >= identity.runs || !shard.identity.shard.holds(run) {
                return Err(MergeError::OtherShard {
                    name: shard.name.clone(),
                    run,
                    shard: shard.identity.shard.to_string(),
                    runs: identity.runs,
                });
            }
            if let Some(before) = owner.insert(run, place) {
                return Err(MergeError::Overlap {
                    run,
                    first: shards[before].name.clone(),
                    second: shard.name.clone(),
                });
            }
        }
    }
    let missing = gaps(owner.keys().copied(), identity.runs);
    if !missing.is_empty() {
        return Err(MergeError::Missing {
            missing: identity.runs - owner.len() as u64,
            runs: identity.runs,
            named: named(&missing),
        });
    }
    let mut runs: Vec<_> = shards.into_iter().flat_map(|s| s.records.runs).collect();
    runs.sort_by_key(|record| record.run);
    Ok((identity, CampaignRecords { parameters, runs }))
}

/// The stretches of numbers below `end`, first and last, that are not among `numbers`, which rise.
fn gaps(numbers: impl Iterator<Item = u64>, end: u64) -> Vec<[u64; 2]> {
    let mut gaps = vec![];
    let mut next = 0;
    for number in numbers.chain([end]) {
        if next < number {
            gaps.push([next, number - 1]);
        }
        next = number.saturating_add(1);
    }
    gaps
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::campaign::identity::CampaignInput;
    use crate::campaign::record::{FIGURES, RunFigures, RunOutcome, RunRecord};
    use proptest::prelude::*;

    fn whole(runs: u64) -> ShardResults {
        let record = |run: u64| RunRecord {
            run,
            seed: run * run,
            drawn: vec![run as f64],
            figures: RunFigures::from_columns(RunOutcome::Completed, [run as f64; FIGURES], 0),
        };
        ShardResults {
            name: "whole".into(),
            identity: CampaignIdentity {
                schema_version: 1,
                version: "1".into(),
                commit: "unknown".into(),
                seed: 7,
                runs,
                shard: "1/1".parse().unwrap(),
                inputs: vec![CampaignInput {
                    option: "scenario".into(),
                    file: "bench.toml".into(),
                    text: "x".into(),
                    sha256: String::new(),
                }],
                gains: serde_json::Map::new(),
            },
            records: CampaignRecords {
                parameters: vec!["p".into()],
                runs: (0..runs).map(record).collect(),
            },
        }
    }

    /// The whole in so many shards.
    fn sharded(whole: &ShardResults, of: u64) -> Vec<ShardResults> {
        let part = |number| {
            let mut shard = whole.clone();
            shard.name = format!("shard-{number}");
            shard.identity.shard = format!("{number}/{of}").parse().unwrap();
            let held = shard.identity.shard;
            shard.records.runs.retain(|record| held.holds(record.run));
            shard
        };
        (1..=of).map(part).collect()
    }

    proptest! {
        #[test]
        fn shards_in_any_order_are_the_whole(runs in 0..60_u64, of in 1..9_u64, turn in 0..9_usize) {
            let whole = whole(runs);
            let mut shards = sharded(&whole, of);
            let turn = turn % shards.len();
            shards.rotate_left(turn);
            let (identity, records) = merge(shards).unwrap();
            prop_assert_eq!(identity, whole.identity);
            prop_assert_eq!(records, whole.records);
        }
    }

    fn refused(change: impl Fn(&mut Vec<ShardResults>)) -> String {
        let mut shards = sharded(&whole(20), 3);
        change(&mut shards);
        merge(shards).unwrap_err().to_string()
    }

    #[test]
    fn what_makes_no_campaign_is_refused_by_name() {
        assert_eq!(
            refused(|shards| shards[2].identity.seed = 8),
            "shard-1 and shard-3 are of different campaigns: seed 7 and 8"
        );
        assert_eq!(
            refused(|shards| shards[1].identity.inputs[0].text = "y".into()),
            "shard-1 and shard-2 are of different campaigns: other texts of --scenario"
        );
        assert_eq!(
            refused(|shards| shards[1].records.parameters[0] = "q".into()),
            "shard-1 and shard-2 are of different campaigns: other parameters are drawn"
        );
        assert_eq!(
            refused(|shards| shards.push(shards[1].clone())),
            "run 1 is both in shard-2 and in shard-2: every run once is accepted"
        );
        assert_eq!(
            refused(|shards| shards[1].records.runs[0].run = 3),
            "shard-2 has run 3, which is none of shard 2/3 of 20 runs"
        );
        assert_eq!(
            refused(|shards| shards[1].records.runs[0].run = 22),
            "shard-2 has run 22, which is none of shard 2/3 of 20 runs"
        );
        assert_eq!(
            refused(|shards| drop(shards.remove(1))),
            "7 of 20 runs are missing: 1, 4, 7, 10, 13, 16 and 19"
        );
        assert_eq!(
            refused(|shards| {
                shards[0].records.runs.clear();
                shards[1].records.runs.truncate(1);
                shards[2].records.runs.remove(0);
            }),
            "14 of 20 runs are missing: 0, 2-4, 6-7, 9-10, 12-13, 15-16 and 18-19"
        );
        assert_eq!(refused(Vec::clear), MergeError::NoShards.to_string());
    }

    #[test]
    fn a_campaign_of_very_many_missing_runs_is_refused_at_once() {
        let mut shard = whole(3);
        shard.identity.runs = u64::MAX;
        let error = merge(vec![shard]).unwrap_err().to_string();
        assert!(
            error.ends_with(&format!("missing: 3-{}", u64::MAX - 1)),
            "{error}"
        );
        let many: Vec<[u64; 2]> = (0..40).map(|i| [2 * i, 2 * i]).collect();
        assert_eq!(named(&many), "0, 2, 4, 6, 8, 10, 12, 14, ...");
    }
}
