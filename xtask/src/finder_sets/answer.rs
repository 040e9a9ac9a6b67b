//! What one run of the program answered, read from its JSON.

use serde_json::Value;

/// An answer, whichever finder gave it.
#[derive(Clone, Debug, Default)]
pub struct FinderAnswer {
    /// The verdict's word.
    pub verdict: String,
    /// Why it is undecidable, where the program says.
    pub reason: String,
    /// What is named, one group for each finding; several effects are an "or".
    pub groups: Vec<Vec<String>>,
    /// Effects with other values than in the model that was handed in.
    pub changed: Vec<String>,
    /// Kinds of issues with the recording.
    pub issues: Vec<String>,
    /// Error of the first and of the last model, um: held out where there is one.
    pub before_um: Option<f64>,
    /// As `before_um`.
    pub after_um: Option<f64>,
    /// Noise, um.
    pub noise_um: Option<f64>,
    /// Errors by record with role, um; only `explain` writes them.
    pub records: Vec<(String, String, f64)>,
}

fn texts(value: &Value) -> Vec<String> {
    value.as_array().map_or_else(Vec::new, |all| {
        all.iter()
            .filter_map(|v| v.as_str().map(str::to_owned))
            .collect()
    })
}

/// Errors by record with role, um.
pub fn records_of(json: &Value) -> Vec<(String, String, f64)> {
    let record = |r: &Value| {
        Some((
            r["file"].as_str()?.to_owned(),
            r["role"].as_str()?.to_owned(),
            r["rms_um"].as_f64()?,
        ))
    };
    let all = json["records"].as_array();
    all.map_or_else(Vec::new, |all| all.iter().filter_map(record).collect())
}

/// What matters of an error, as the method says: 2 %.
const MATTERS: f64 = 1.02;

/// The evidence of a finding: the best model without it is worse on fitted or held-out records by what matters,
/// and better on neither.
fn speaks_for_its_name(finding: &Value) -> Result<(), String> {
    let evidence = &finding["evidence"];
    let rises = |side: &str| {
        let of = |model: &str| evidence[model][side].as_f64();
        Some(of("without")? / of("with")?)
    };
    let sides: Vec<f64> = ["identify", "validate"]
        .into_iter()
        .filter_map(rises)
        .collect();
    let speaks = sides.iter().any(|by| *by > MATTERS) && sides.iter().all(|by| by * MATTERS > 1.0);
    if speaks || evidence["by"] != "models" {
        return Ok(());
    }
    Err(format!("the evidence speaks against its name: {finding}"))
}

impl FinderAnswer {
    /// From `hysteron.fit/1` with a diagnosis, or from `hysteron.diagnosis/1`.
    pub fn of(json: &Value) -> Result<Self, String> {
        let d = json.get("diagnosis").unwrap_or(json);
        let verdict = d["verdict"]
            .as_str()
            .ok_or("the answer holds no verdict")?
            .to_owned();
        let named = texts(&d["named"]);
        // Only what these two words claim is a name.
        let claims = verdict == "named" || verdict == "ambiguous";
        let findings = d["findings"].as_array().cloned().unwrap_or_default();
        findings.iter().try_for_each(speaks_for_its_name)?;
        let groups = findings
            .iter()
            .map(|f| texts(&f["effects"]))
            .filter(|g| claims && g.iter().any(|id| named.contains(id)));
        let each = |key: &str, of: &str| -> Vec<String> {
            let all = d[key].as_array().cloned().unwrap_or_default();
            let mut out: Vec<String> = all
                .iter()
                .filter_map(|v| v[of].as_str().map(str::to_owned))
                .collect();
            out.dedup();
            out
        };
        let error = |key: &str| {
            let errors = &d[key];
            errors["validate"]
                .as_f64()
                .or_else(|| errors["identify"].as_f64())
        };
        Ok(Self {
            reason: d["reason"].as_str().unwrap_or_default().to_owned(),
            groups: groups.collect(),
            changed: each("changed", "effect"),
            issues: each("issues", "kind"),
            before_um: error("residual_rms_um"),
            after_um: error("residual_rms_after_um"),
            noise_um: d["noise_floor_um"].as_f64(),
            records: records_of(json),
            verdict,
        })
    }

    /// The groups in one word: `creep+delay|vibration` is creep, and delay or vibration. The order says
    /// nothing.
    pub fn said(&self) -> String {
        let changed = self.changed.iter().map(|id| format!("{id}*"));
        let mut groups: Vec<String> = self
            .groups
            .iter()
            .map(|g| g.join("|"))
            .chain(changed)
            .collect();
        groups.sort();
        groups.join("+")
    }

    /// The same, whatever the order within an "or".
    pub fn names(&self) -> String {
        let sorted = self.groups.iter().map(|group| {
            let mut group = group.clone();
            group.sort();
            group
        });
        Self {
            groups: sorted.collect(),
            ..self.clone()
        }
        .said()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn evidence_against_its_name_is_no_answer() {
        let answer = |without: [f64; 2]| {
            let [identify, validate] = without;
            let evidence = json!({
                "by": "models",
                "without": { "identify": identify, "validate": validate },
                "with": { "identify": 0.01, "validate": 0.02 },
            });
            let finding = json!({ "effects": ["creep"], "evidence": evidence });
            FinderAnswer::of(
                &json!({ "verdict": "named", "named": ["creep"], "findings": [finding] }),
            )
        };
        assert!(answer([0.05, 0.05]).is_ok() && answer([0.0099, 0.05]).is_ok());
        assert!(answer([0.009, 0.05]).is_err() && answer([0.01, 0.0201]).is_err());
        let readings = json!({ "effects": ["quantisation"], "evidence": { "by": "readings" } });
        assert!(FinderAnswer::of(&json!({ "verdict": "named", "findings": [readings] })).is_ok());
    }
}
