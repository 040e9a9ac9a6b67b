//! Text files as loggers, oscilloscopes and spreadsheets write them: the same recording in every habit is the
//! same data set.

#![cfg(feature = "readers")]

use hysteron::Dataset;
use hysteron::dataset::Role;
use hysteron::dataset::column_rules::ColumnRules;
use hysteron::dataset::column_rules::{ColumnName, PerColumn};
use hysteron::dataset::reading::{
    Instructions, from_file, from_file_as, from_manifest, from_two_files_as,
};
use hysteron::dataset::timing::Timing;
use std::collections::BTreeMap;
use std::fmt::Write;

const SAMPLES: usize = 600;
const RATE_HZ: f64 = 2000.0;

/// Time in s, drive in V, displacement in um of a stage with some lag and noise.
fn recording() -> Vec<[f64; 3]> {
    let drive = |k: f64| 20.0 - 20.0 * (k * 0.02).cos() * (1.0 - k * 5e-4);
    let noise = |k: usize| ((k as f64 * 12.9898).sin() * 43758.5453).rem_euclid(1.0) - 0.5;
    (0..SAMPLES)
        .map(|k| {
            [
                k as f64 / RATE_HZ,
                drive(k as f64),
                0.25 * drive(k as f64 - 4.0) + 0.004 * noise(k),
            ]
        })
        .collect()
}

/// The recording as rows of text.
fn rows(row: impl Fn(&[f64; 3]) -> String) -> String {
    recording().iter().fold(String::new(), |mut text, values| {
        writeln!(text, "{}", row(values)).unwrap();
        text
    })
}

fn plain(separator: &str) -> String {
    rows(|[t, u, y]| format!("{t:.4}{separator}{u:.6}{separator}{y:.6}"))
}

/// The file gives the recording, and its notes hold these words.
fn gives(name: &str, bytes: impl AsRef<[u8]>, words: &[&str]) -> Dataset {
    gives_as(name, bytes, &Instructions::default(), words)
}

fn gives_as(
    name: &str,
    bytes: impl AsRef<[u8]>,
    instructions: &Instructions,
    words: &[&str],
) -> Dataset {
    let dataset =
        from_file_as(name, bytes.as_ref(), instructions).unwrap_or_else(|e| panic!("{e}"));
    let last = dataset.records.last().unwrap();
    assert!(
        (last.sample_rate_hz / RATE_HZ - 1.0).abs() < 1e-3,
        "{name}: {} Hz",
        last.sample_rate_hz
    );
    assert_eq!(last.drive_v.len(), SAMPLES, "{name}");
    for (k, [_, u, y]) in recording().iter().enumerate() {
        assert!(
            (last.drive_v[k] - u).abs() < 2e-5,
            "{name}, sample {k}: drive {} instead of {u}",
            last.drive_v[k]
        );
        assert!(
            (last.displacement_um[k] - y).abs() < 2e-5,
            "{name}, sample {k}: {} instead of {y}",
            last.displacement_um[k]
        );
    }
    let notes = dataset.notes.join("\n");
    for word in words {
        assert!(
            notes.contains(word),
            "{name}: expected `{word}` in\n{notes}"
        );
    }
    dataset
}

fn refused(name: &str, bytes: impl AsRef<[u8]>, words: &[&str]) {
    let said = from_file(name, bytes.as_ref()).expect_err(name).to_string();
    for word in words {
        assert!(said.contains(word), "{name}: expected `{word}` in: {said}");
    }
}

#[test]
fn separators_headers_and_decimal_commas() {
    let known = gives("a.csv", format!("t_s,u_v,y_um\n{}", plain(",")), &[]);
    assert!(
        !known.notes.join("\n").contains("columns:"),
        "what the file specifies needs no note: {:?}",
        known.notes
    );
    gives(
        "a.csv",
        format!("t [s];u [V];y [um]\r\n{}", plain(";").replace('\n', "\r\n")),
        &[],
    );
    let old = format!("t_s,u_v,y_um\n{}", plain(",")).replace('\n', "\r");
    gives("a.csv", old, &[]);
    gives(
        "a.csv",
        format!(
            "t_s,u_v,u_v,y_um\n{}",
            rows(|[t, u, y]| format!("{t:.4},{u:.6},{u:.6},{y:.6}"))
        ),
        &[
            "`u [v]` (column 2) is taken",
            "not column `u [v]` (column 3)",
        ],
    );
    gives("a.txt", format!("# t_s u_V y_um\n{}", plain(" ")), &[]);
    gives(
        "a.txt",
        format!("Time (s)\tVoltage (V)\tPosition (µm)\n{}", plain("\t")),
        &[],
    );
    gives(
        "a.dat",
        format!("%  t u y\n{}", plain("   ")),
        &["u = column `u`", "unit not said: taken as V"],
    );
    let german = format!(
        "Zeit [s];Spannung [V];Weg [µm]\n{}",
        plain(";").replace('.', ",")
    );
    gives("a.csv", &german, &["commas as decimal sign"]);
    gives(
        "a.csv",
        format!("\u{feff}t_s,u_v,y_um\n{}", plain(",")),
        &[],
    );
    let quoted = format!(
        "\"t, s\",\"u, V\",\"y, um\"\n{}",
        rows(|[t, u, y]| format!("\"{t:.4}\",\"{u:.6}\",\"{y:.6}\""))
    );
    gives("a.csv", &quoted, &[]);
    gives(
        "a.csv",
        format!(
            "Stage 7\nOperator: somebody\n\n\nt_s,u_v,y_um,\n{}",
            plain(",").replace('\n', ",\n")
        ),
        &[],
    );
}

#[test]
fn encodings() {
    let latin: Vec<u8> = format!("Zeit [s];Spannung [V];Weg [µm]\n{}", plain(";"))
        .chars()
        .map(|c| c as u32 as u8)
        .collect();
    gives("a.csv", &latin, &["read as Latin-1"]);
    let text = format!("t_s\tu_v\ty_um\n{}", plain("\t"));
    let utf_16: Vec<u8> = [0xff, 0xfe]
        .into_iter()
        .chain(text.encode_utf16().flat_map(u16::to_le_bytes))
        .collect();
    gives("a.txt", &utf_16, &[]);
    refused(
        "a.csv",
        [0, 1, 2, 3, 200, 201, 0, 0, 7],
        &["no text", "expected CSV"],
    );
}

#[test]
fn units_in_names_and_in_a_second_line() {
    let scaled = |separator: &str| {
        rows(|[t, u, y]| {
            format!(
                "{:.2}{separator}{:.4}{separator}{:.4}",
                1e3 * t,
                1e3 * u,
                1e3 * y
            )
        })
    };
    gives(
        "a.csv",
        format!("t (ms),u [mV],pos_nm\n{}", scaled(",")),
        &["column `t [ms]`", "column `pos [nm]`"],
    );
    gives(
        "a.csv",
        format!("time,drive,position\nms,mV,nm\n{}", scaled(",")),
        &["[ms]"],
    );
    gives(
        "a.csv",
        format!(
            "Time,Channel A,Channel B\n(ms),(mV),(nm)\n\n{}",
            scaled(",")
        ),
        &["column `Channel B [nm]`"],
    );
    refused(
        "a.csv",
        format!("t [h],u [V],y [um]\n{}", plain(",")),
        &["t [h]", "ms"],
    );
    let in_volts = gives(
        "a.csv",
        format!("t [s],u [V],y [V]\n{}", plain(",")),
        &["kept in V", "--units y=5um/V"],
    );
    assert_eq!(in_volts.units.reading, "V");
}

#[test]
fn what_a_person_says_goes_first() {
    let text = format!(
        "a,b,c\n{}",
        rows(|[t, u, y]| format!("{:.6},{:.2},{:.5}", y / 5.0, 1e3 * t, 1e3 * u))
    );
    let number = |n| Some(ColumnName::Number(n));
    let wanted = ColumnRules {
        columns: PerColumn {
            t: number(2),
            u: Some(ColumnName::Name("c".into())),
            y: number(1),
            force: None,
        },
        unit: PerColumn {
            t: Some("ms".into()),
            u: Some("mV".into()),
            y: Some("5um/V".into()),
            force: None,
        },
        ..ColumnRules::default()
    };
    gives_as(
        "a.csv",
        &text,
        &Instructions {
            wanted,
            ..Instructions::default()
        },
        &["in 5um/V"],
    );
    let no_time = rows(|[_, u, y]| format!("{u:.6};{y:.6}"));
    refused("a.csv", &no_time, &["--sample-rate-hz"]);
    let rate = Instructions {
        sample_rate_hz: Some(RATE_HZ),
        ..Instructions::default()
    };
    gives_as(
        "a.csv",
        &no_time,
        &rate,
        &["column 1 is taken for the drive"],
    );
    let skipped = Instructions {
        skip_rows: Some(3),
        ..Instructions::default()
    };
    gives_as(
        "a.csv",
        format!("1,2,3\n4,5,6\n7,8,9\nt_s,u_v,y_um\n{}", plain(",")),
        &skipped,
        &[],
    );
}

#[test]
fn a_manifest_says_units_factors_and_rows_and_one_file_serves_twice() {
    let text = format!(
        "9 9 9\n{}",
        rows(|[t, u, y]| format!("{:.3} {:.6} {:.6}", 1e3 * t, u / 15.0, y / 5.0))
    );
    let manifest = "name = \"m\"\ndrive_min_v = 0.0\ndrive_max_v = 40.0\n[[record]]\nfile = \"a.txt\"\nname = \"rise\"\nrole = \"identify\"\n\
                    initial_state = \"unknown\"\nskip_rows = 1\nunit = { t = \"ms\", y = \"5 um/V\" }\nscale = { u = 15.0 }\n\
                    columns = { t = 1, u = 2, y = 3 }\nto_s = 0.1\n\
                    [[record]]\nfile = \"a.txt\"\nrole = \"validate\"\ninitial_state = \"unknown\"\nskip_rows = 1\n\
                    unit = { t = \"ms\", y = \"5 um/V\" }\nscale = { u = 15.0 }\ncolumns = { t = 1, u = 2, y = 3 }\nfrom_s = 0.1\n";
    let files = BTreeMap::from([("a.txt".to_owned(), text.into_bytes())]);
    let dataset = from_manifest(manifest, "dataset.toml", &files).unwrap();
    let record = &dataset.records[0];
    assert_eq!(
        (record.name.as_str(), dataset.records[1].name.as_str()),
        ("rise", "a")
    );
    assert!((record.sample_rate_hz - RATE_HZ).abs() < 1e-3);
    assert_eq!(record.window, 0..200);
    assert!(
        (record.displacement_um[100] - recording()[100][2]).abs() < 1e-5
            && (record.drive_v[100] - recording()[100][1]).abs() < 2e-5
    );
}

#[test]
fn columns_without_names_are_known_by_what_they_do() {
    // As in measured files: an empty first column, then t, y, u.
    gives(
        "a.csv",
        rows(|[t, u, y]| format!(",{t:.4},{y:.6},{u:.6}")),
        &["column 4 is taken for the drive, because it leads"],
    );
    gives(
        "a.csv",
        plain(","),
        &[
            "t = column 1, rising evenly, unit not said: taken as s",
            "--columns",
        ],
    );
    gives(
        "a.csv",
        rows(|[t, u, y]| format!("{u:.6} {y:.6} {t:.4}")),
        &["column 1 is taken for the drive"],
    );
    gives(
        "a.csv",
        rows(|[t, u, y]| format!("{t:.4} {:.6} {u:.6} 21.5", y)),
        &["column 3 is taken for the drive"],
    );
    // A second drive column is the amplifier's monitor, noisy and late.
    let monitor = |u: f64, t: f64| u + 0.05 * ((t * 1e7) % 1.0);
    let text = format!(
        "t_s,u_v,u_monitor_v,y_um\n{}",
        rows(|[t, u, y]| format!("{t:.4},{u:.6},{:.6},{y:.6}", monitor(*u, *t)))
    );
    gives(
        "a.csv",
        &text,
        &["2 columns may be the drive: column `u [v]` (column 2) is taken"],
    );
    // A second sensor of half the gain; of equals the first is read.
    let with_sensors = |header: &str| {
        let row = |[t, u, y]: &[f64; 3]| format!("{t:.4},{u:.6},{y:.6},{:.6}", 0.5 * y);
        format!("{header}\n{}", rows(row))
    };
    gives(
        "a.csv",
        with_sensors("t_s,u_v,y_um,sensor_b"),
        &[
            "column `sensor_b` may be the displacement as well: column `y [um]` is taken; to take the other: --columns y=4",
        ],
    );
    gives(
        "a.csv",
        with_sensors("t_s,u_v,sensor_a_um,sensor_b_um"),
        &["2 columns may be the displacement: column `sensor_a [um]` (column 3) is taken"],
    );
    let warm = rows(|[t, u, y]| format!("{t:.4},{u:.6},{y:.6},{:.3}", 21.0 + t));
    gives(
        "a.csv",
        format!("t_s,u_v,y_um,temperature_c\n{warm}"),
        &["looks like a temperature; --auxiliary temperature=4"],
    );
    let exchanged = format!("t_s,y_um,u_v\n{}", plain(","));
    let notes = from_file("a.csv", exchanged.as_bytes())
        .unwrap()
        .notes
        .join("\n");
    assert!(notes.contains("are they exchanged?"), "{notes}");
}

#[test]
fn loggers_and_oscilloscopes() {
    let labview = "LabVIEW Measurement\t\nWriter_Version\t2\nReader_Version\t2\nSeparator\tTab\nDecimal_Separator\t.\nMulti_Headings\tNo\n\
                   X_Columns\tOne\nTime_Pref\tRelative\nDate\t2026/01/01\nTime\t12:00:00.5\n***End_of_Header***\t\n\t\nChannels\t2\t\t\n\
                   Samples\t600\t600\t\nDate\t2026/01/01\t2026/01/01\t\nY_Unit_Label\tVolts\tum\t\nX_Dimension\tTime\tTime\t\n\
                   X0\t0.0000000000000000E+0\t0.0000000000000000E+0\t\nDelta_X\t0.000500\t0.000500\t\n***End_of_Header***\t\t\t\n";
    let with_time = format!(
        "{labview}X_Value\tUntitled\tUntitled 1\tComment\n{}",
        plain("\t")
    );
    gives("a.lvm", &with_time, &["t = column `X_Value`"]);
    let without = labview.replace("X_Columns\tOne", "X_Columns\tNo");
    let without = format!(
        "{without}X_Value\tUntitled\tUntitled 1\tComment\n{}",
        rows(|[_, u, y]| format!("\t{u:.6}\t{y:.6}"))
    );
    gives(
        "a.lvm",
        &without,
        &["2000.000000 samples per second, as the file says"],
    );

    let sensor = Instructions {
        wanted: ColumnRules {
            unit: PerColumn {
                y: Some("5 um/V".into()),
                ..PerColumn::default()
            },
            ..ColumnRules::default()
        },
        ..Instructions::default()
    };
    let volts = || rows(|[t, u, y]| format!("{t:.6e},{u:.6},{:.7}", y / 5.0));
    let tektronix = format!(
        "Model,MSO4034\nFirmware Version,2.48\n\nWaveform Type,ANALOG,,\nHorizontal Units,s,,\nSample Interval,5.0E-4,,\nVertical Units,V,V,\n\n\nTIME,CH1,CH2\n{}",
        volts()
    );
    gives_as(
        "tek.csv",
        &tektronix,
        &sensor,
        &["column `CH1 [V]` is taken for the drive"],
    );
    // A channel for each time: the units stand over the channels, and not over the columns of time.
    let own_times = rows(|[t, u, y]| format!("{t:.6e},{u:.6},{t:.6e},{:.7}", y / 5.0));
    let head = "Model,MDO3024\n\nHorizontal Units,s,,s\nSample Interval,5.0E-4,,5.0E-4\nVertical Units,V,,V\n\nTIME,CH1,TIME,CH2\n";
    let own_times = format!("{head}{own_times}");
    gives_as(
        "tek.csv",
        &own_times,
        &sensor,
        &[
            "column `CH1 [V]` is taken for the drive",
            "two columns of time that agree",
        ],
    );
    refused(
        "tek.csv",
        &own_times,
        &[
            "column `CH2 [V]` is the displacement in volts",
            "--units y=5um/V",
        ],
    );
    let peaks = rows(|[t, u, y]| format!("{t:.6e},{u:.6},,{:.7},", y / 5.0));
    for units in ["V,,V,", "V,V,"] {
        let text = format!(
            "Model,MDO3024\nVertical Units,{units}\n\nTIME,CH1,CH1 Peak Detect,CH2,CH2 Peak Detect\n{peaks}"
        );
        gives_as(
            "tek.csv",
            &text,
            &sensor,
            &["column `CH1 [V]` is taken for the drive"],
        );
        refused(
            "tek.csv",
            &text,
            &["column `CH2 [V]` is the displacement in volts"],
        );
    }
    let keysight = format!("x-axis,1,2\nsecond,Volt,Volt\n{}", volts());
    gives_as(
        "key.csv",
        &keysight,
        &sensor,
        &["column `1 [Volt]` is taken for the drive"],
    );
    // Commas at the ends of header and rows, as this or that series of Rigol has them.
    for (of_names, of_units, of_rows) in [
        (",", "", ",,,"),
        (",", "", ","),
        (",", "", ""),
        ("", "", ",,"),
        ("", "", ""),
        (",", ",", ","),
    ] {
        let mut rigol = format!(
            "X,CH1,CH2,Start,Increment{of_names}\nSequence,Volt,Volt,0.0,5.0e-4{of_units}\n"
        );
        for (count, [_, u, y]) in recording().iter().enumerate() {
            writeln!(rigol, "{count},{u:.6},{:.7}{of_rows}", y / 5.0).unwrap();
        }
        gives_as(
            "rigol.csv",
            &rigol,
            &sensor,
            &["column `CH1 [Volt]` is taken for the drive"],
        );
        refused(
            "rigol.csv",
            &rigol,
            &["column `CH2 [Volt]` is the displacement in volts"],
        );
    }
    let rohde = format!("\"in s\",\"C1 in V\",\"C2 in V\"\n{}", volts());
    gives_as(
        "rs.csv",
        &rohde,
        &sensor,
        &["column `C1 [V]` is taken for the drive"],
    );
    refused(
        "rs.csv",
        &rohde,
        &[
            "column `C2 [V]` is the displacement in volts",
            "--units y=5um/V",
        ],
    );
    // Old Tektronix: keys and values beside the samples, each channel with its own time.
    let mut line = 0;
    let old = recording().iter().fold(String::new(), |text, [t, u, y]| {
        line += 1;
        let side = [
            "Record Length,600,Points,",
            "Sample Interval,5e-4,s,",
            "Vertical Units,V,,",
        ]
        .get(line - 1)
        .copied()
        .unwrap_or(",,,");
        format!("{text}{side}{t:.4},{u:.6},{side}{t:.4},{:.7},\n", y / 5.0)
    });
    gives_as(
        "tds.csv",
        &old,
        &sensor,
        &["two columns of time that agree"],
    );
}

#[test]
fn one_file_is_fitted_and_another_one_judges() {
    let volts = format!(
        "t_s,u_v,y_um\n{}",
        rows(|[t, u, y]| format!("{t:.4},{u:.6},{y:.6}"))
    );
    let newtons = volts.replace("u_v", "u [N]");
    let two = |other: &str| {
        let files = (("a.csv", volts.as_bytes()), ("b.csv", other.as_bytes()));
        from_two_files_as(files.0, files.1, &Instructions::default())
    };
    let dataset = two(&volts).unwrap();
    let roles: Vec<_> = dataset
        .records
        .iter()
        .map(|r| (r.name.as_str(), r.role))
        .collect();
    assert_eq!(
        roles,
        [("a_fitted", Role::Identify), ("b_held_out", Role::Validate)]
    );
    // All that moves counts, in both.
    assert!(
        dataset
            .records
            .iter()
            .all(|r| r.left_out.is_empty() && r.window.len() > SAMPLES / 2)
    );
    let said = two(&newtons).unwrap_err().to_string();
    assert!(
        said.contains("b.csv") && said.contains("other units"),
        "{said}"
    );
}

#[test]
fn two_columns_of_time() {
    // The second channel is sampled half a period later and ends earlier.
    let text = format!(
        "t_u,u_v,t_y,y_um\n{}",
        rows(|[t, u, _]| format!("{t:.5},{u:.6},{:.5},{:.6}", t + 0.00025, 100.0 * t + 0.025))
    );
    let dataset = from_file("a.csv", text.as_bytes()).unwrap();
    let record = dataset.records.last().unwrap();
    assert!(
        dataset
            .notes
            .join("\n")
            .contains("which is interpolated to the first"),
        "{:?}",
        dataset.notes
    );
    for (k, y) in record.displacement_um.iter().enumerate() {
        assert!(
            (y - 100.0 * (k + 1) as f64 / RATE_HZ).abs() < 1e-5,
            "{k}: {y}"
        );
    }
}

#[test]
fn two_columns_of_time_of_one_clock() {
    // Seconds from the start beside those of another moment, a second or half a century before: nothing is
    // interpolated, and no sample is lost.
    for (from_s, said) in [
        (1.0, "1.000000 s apart"),
        (1.7e9, "1700000000.000000 s apart"),
    ] {
        for header in ["t,clock,u_v,y_um", "t_s,epoch_s,u_v,y_um"] {
            let text = format!(
                "{header}\n{}",
                rows(|[t, u, y]| format!("{t:.4},{:.4},{u:.6},{y:.6}", from_s + t))
            );
            let dataset = from_file("a.csv", text.as_bytes()).unwrap();
            assert!(
                dataset.notes.join("\n").contains(said),
                "{:?}",
                dataset.notes
            );
            assert_eq!(dataset.records.last().unwrap().drive_v.len(), SAMPLES);
        }
    }
}

#[test]
fn times_of_day_and_stamps_that_jitter() {
    let stamp = |t: f64| format!("2026-03-01 12:00:{:09.6}", 1.0 + t);
    gives(
        "a.csv",
        format!(
            "timestamp,u_v,y_um\n{}",
            rows(|[t, u, y]| format!("{},{u:.6},{y:.6}", stamp(*t)))
        ),
        &[],
    );
    let mut lines: Vec<String> = plain(",").lines().map(String::from).collect();
    lines[300] = lines[300].replacen("0.1500", "0.1502", 1);
    lines.remove(100);
    lines.insert(50, lines[49].clone());
    let dataset = from_file(
        "a.csv",
        format!("t_s,u_v,y_um\n{}", lines.join("\n")).as_bytes(),
    )
    .unwrap();
    let notes = dataset.notes.join("\n");
    for word in [
        "row 52 has the time stamp of the row before",
        "one sample is missing, before row 103",
        "jitter by up to 40 %",
        "2000.000000 Hz",
    ] {
        assert!(notes.contains(word), "{word}: {notes}");
    }
    assert_eq!(dataset.records.last().unwrap().drive_v.len(), SAMPLES);
    let milliseconds = format!(
        "t,u_v,y_um\n{}",
        rows(|[t, u, y]| format!("{:.1},{u:.6},{y:.6}", 1e3 * t))
    );
    let notes = from_file("a.csv", milliseconds.as_bytes())
        .unwrap()
        .notes
        .join("\n");
    assert!(
        notes.contains("t = column `t` (column 1), unit not said: taken as s"),
        "{notes}"
    );
}

#[test]
fn damage_is_told_with_its_place() {
    let good = format!("t_s,u_v,y_um\n{}", plain(","));
    let with = |row: usize, text: &str| {
        let mut lines: Vec<&str> = good.lines().collect();
        lines[row - 1] = text;
        lines.join("\n")
    };
    let headed = |rows: String| format!("t,u,y\n{rows}");
    let mixed = plain(";").replacen("0.0100", "0,0100", 1);
    for (text, words) in [
        (String::new(), &["empty"][..]),
        ("\n\n  \n".into(), &["empty"]),
        ("t_s,u_v,y_um\n".into(), &["no rows of numbers"]),
        (
            "nothing but words\nand more words\n".into(),
            &["no rows of numbers", "row 2"],
        ),
        (with(2, "0.0,abc,1.0"), &["row 2", "abc"]),
        (with(41, "0.0195,abc,1.0"), &["row 41", "`u [v]`", "abc"]),
        (with(41, "0.0195,NaN,1.0"), &["row 41", "`u [v]`", "finite"]),
        (with(41, "0.0195,1e999,1.0"), &["row 41", "finite"]),
        (with(41, "0.0195,1.0"), &["row 41", "2 cells", "3"]),
        (with(41, "0.0195,1.0,2.0,3.0"), &["row 41", "4 cells", "3"]),
        (with(41, "0.0195,,1.0"), &["row 41", "blank"]),
        (with(41, "0.0100,1.0,1.0"), &["row 41", "does not increase"]),
        (with(41, "0.0195;1.0;1.0"), &["row 41"]),
        // Short as a last row that was cut off, but with a line end, or with words.
        (format!("{good}0.3000,1.0\n"), &["row 602", "2 cells", "3"]),
        (
            format!("{good}stopped by hand"),
            &["row 602", "1 cells", "3"],
        ),
        (
            headed(plain(",").replace('.', ",")),
            &["6 cells under a header of 3", "decimal commas"],
        ),
        (mixed, &["row 21", "decimal comma"]),
    ] {
        refused("a.csv", &text, words);
    }
    // All of them at once.
    let mut lines: Vec<&str> = good.lines().collect();
    (lines[40], lines[50], lines[59]) = ("0.0195,NaN,1.0", "0.0245,NaN,1.0", "0.0290,1.0,inf");
    refused(
        "a.csv",
        lines.join("\n"),
        &["row 41", "NaN, and in 2 more rows up to row 60"],
    );
    let mut flipped = good.clone().into_bytes();
    flipped[2000] ^= 0x80;
    assert!(from_file("a.csv", &flipped).is_err());
    let jump = good.replace("0.2500,", "9.2500,");
    refused("a.csv", &jump, &["row 503", "does not increase"]);
}

#[test]
fn a_last_row_that_may_be_cut_off_is_left_aside() {
    let text = format!("t_s,u_v,y_um\n{}", plain(","));
    let whole = gives("a.csv", &text, &[]);
    assert!(!whole.notes.join("\n").contains("cut off"));
    // Without its line end the last row is still whole.
    gives("a.csv", text.trim_end(), &[]);
    // With a digit less its number is another one.
    let cut = from_file("a.csv", &text.as_bytes()[..text.len() - 2]).unwrap();
    assert_eq!(cut.records.last().unwrap().drive_v.len(), SAMPLES - 1);
    let note = format!("row {} is the last and has no line end", SAMPLES + 1);
    assert!(
        cut.notes.iter().any(|said| said.contains(&note)),
        "{:?}",
        cut.notes
    );
    // Wherever it was cut.
    let (whole, last) = text.trim_end().rsplit_once('\n').unwrap();
    for characters in 1..last.len() {
        let cut = from_file(
            "a.csv",
            format!("{whole}\n{}", &last[..characters]).as_bytes(),
        )
        .unwrap();
        assert_eq!(
            cut.records.last().unwrap().drive_v.len(),
            SAMPLES - 1,
            "{}",
            &last[..characters]
        );
        assert!(
            cut.notes.iter().any(|said| said.contains(&note)),
            "{:?}",
            cut.notes
        );
    }
}

#[test]
fn rows_in_another_notation_are_not_lost() {
    let half = |text: &str, first: bool| {
        let lines: Vec<&str> = text.lines().collect();
        let part = if first {
            &lines[..SAMPLES / 2]
        } else {
            &lines[SAMPLES / 2..]
        };
        part.join("\n") + "\n"
    };
    let points = plain(",");
    let commas = plain(";").replace('.', ",");
    for (above, below) in [
        (&points, &commas),
        (&commas, &points),
        (&points, &commas.replace(';', ",")),
    ] {
        let mixed = format!("t,u,y\n{}{}", half(above, true), half(below, false));
        refused(
            "mixed.csv",
            &mixed,
            &["row 2", "row 302", "another way", "--skip-rows 301"],
        );
    }
    // A few numbers in a header are none of the rows.
    gives("counts.csv", format!("600,2000\nt,u,y\n{points}"), &[]);
    let beyond = Instructions {
        skip_rows: Some(5000),
        ..Instructions::default()
    };
    let said = from_file_as("short.csv", points.as_bytes(), &beyond)
        .unwrap_err()
        .to_string();
    assert!(
        said.contains("600 lines") && said.contains("5000"),
        "{said}"
    );
}

#[test]
fn signals_that_no_actuator_has_are_refused() {
    let huge = rows(|[t, u, y]| format!("{t:.4},{u:.6},{:.6e}", y * 1e300));
    refused(
        "huge.csv",
        format!("t,u,y\n{huge}"),
        &["row", "at most 1e7 um", "unit"],
    );
    let unit = PerColumn {
        y: Some("5um".to_owned()),
        ..PerColumn::default()
    };
    let said = Instructions {
        wanted: ColumnRules {
            unit,
            ..ColumnRules::default()
        },
        ..Instructions::default()
    };
    let message = from_file_as(
        "um.csv",
        format!("t [s],u [V],y [um]\n{}", plain(",")).as_bytes(),
        &said,
    )
    .unwrap_err()
    .to_string();
    assert!(message.contains("5um/V"), "{message}");
}

#[test]
fn a_signal_that_rises_like_time_is_what_it_is_said_to_be() {
    let text = rows(|[t, u, y]| format!("{t:.4},{u:.6},{y:.6},{:.5}", 22.0 + 3.0 * t));
    let auxiliary = BTreeMap::from([(
        "temperature_c".to_owned(),
        ColumnName::Name("chamber".into()),
    )]);
    let said = Instructions {
        wanted: ColumnRules {
            auxiliary,
            ..ColumnRules::default()
        },
        ..Instructions::default()
    };
    let dataset = gives_as("warm.csv", format!("t,u,y,chamber\n{text}"), &said, &[]);
    let signal = &dataset.records.last().unwrap().auxiliary[0];
    assert!(
        signal.name == "temperature_c"
            && (signal.values[SAMPLES - 1] - 22.0 - 3.0 * (SAMPLES - 1) as f64 / RATE_HZ).abs()
                < 1e-4
    );
}

#[test]
fn what_was_recorded_beside_the_drive_is_cut_with_it_where_the_displacement_begins_later() {
    // The displacement's clock begins ten samples after that of the drive.
    let later = 10.0 / RATE_HZ;
    let text = rows(|[t, u, y]| {
        format!(
            "{t:.4},{u:.6},{:.4},{y:.6},{:.4},{:.4}",
            t + later,
            100.0 * t,
            22.0 + 10.0 * t
        )
    });
    let auxiliary = BTreeMap::from([(
        "temperature_c".to_owned(),
        ColumnName::Name("chamber".into()),
    )]);
    let said = Instructions {
        wanted: ColumnRules {
            auxiliary,
            ..ColumnRules::default()
        },
        ..Instructions::default()
    };
    let dataset = from_file_as(
        "two_clocks.csv",
        format!("t,u,t2,y,force [N],chamber\n{text}").as_bytes(),
        &said,
    )
    .unwrap();
    let record = dataset.records.last().unwrap();
    assert!(
        dataset
            .notes
            .iter()
            .any(|note| note.contains("two columns of time")),
        "{:?}",
        dataset.notes
    );
    assert!(
        (record.drive_v[0] - recording()[10][1]).abs() < 2e-5,
        "{}",
        record.drive_v[0]
    );
    let (force_n, temperature_c) = (
        record.force_n.as_ref().unwrap()[0],
        record.auxiliary[0].values[0],
    );
    assert!(
        (force_n - 100.0 * later).abs() < 1e-3
            && (temperature_c - 22.0 - 10.0 * later).abs() < 1e-3,
        "{force_n} N, {temperature_c}"
    );
}

/// A delay counts from the timing that was assumed, and nothing was where the records show theirs or somebody
/// says it.
#[test]
fn a_timing_is_assumed_only_where_nothing_shows_it() {
    let assumed = |rows: String, timing| {
        let instructions = Instructions {
            timing,
            ..Instructions::default()
        };
        from_file_as(
            "a.csv",
            format!("t_s,u_v,y_um\n{rows}").as_bytes(),
            &instructions,
        )
        .unwrap()
        .timing_is_assumed
    };
    let fast_v = |k: usize| 5.0 - 5.0 * (0.3 * k as f64).cos();
    let read_after_writing = (0..500).fold(String::new(), |rows, k| {
        rows + &format!(
            "{:.3},{:.6},{:.6}\n",
            1e-3 * k as f64,
            fast_v(k),
            0.1 * fast_v(k)
        )
    });
    assert!(assumed(plain(","), None));
    assert!(!assumed(plain(","), Some(Timing::HoldAfterSample)));
    assert!(!assumed(read_after_writing, None));
}

#[test]
fn a_drive_that_is_negative_ends_at_zero_and_not_at_minus_zero() {
    let text = rows(|[t, u, y]| format!("{t:.4},{:.6},{:.6}", -u, -y));
    assert!(text.contains(",-0.000000,"), "as a logger writes it");
    let dataset = from_file("negative.csv", text.as_bytes()).unwrap();
    assert!(
        dataset
            .notes
            .iter()
            .any(|note| note.contains(" to 0 V; the state")),
        "{:?}",
        dataset.notes
    );
    assert!(dataset.drive_max_v.is_sign_positive());
}
