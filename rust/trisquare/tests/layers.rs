//! A room of `src/` imports only from the rows below its own, and the files of a room do not import
//! each other in a cycle.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::read_to_string;
use std::path::{Path, PathBuf};

/// From top to bottom; rooms of one row do not import each other.
const ROWS: [&[&str]; 12] = [
    &["lens_choice"],
    &["calibrate"],
    &["selection", "photometric", "lines"],
    &["solver", "planning"],
    &["uncertainty"],
    &["noise"],
    &["linear", "refine", "synthetic"],
    &["observations", "result"],
    &["lens", "search", "localise"],
    &["geometry", "image", "image_size"],
    &["numeric", "error", "stored"],
    &["ill_conditioning"],
];

/// Returns the Rust files of a folder, or its subfolders, by module name.
fn modules(folder: &Path, files: bool) -> BTreeMap<String, PathBuf> {
    let entries = folder
        .read_dir()
        .unwrap()
        .map(|entry| entry.unwrap().path());
    let wanted = entries.filter(|path| path.is_file() == files);
    let name = |path: &PathBuf| path.file_stem().unwrap().to_str().unwrap().to_owned();
    wanted.map(|path| (name(&path), path)).collect()
}

/// Returns the text of a file up to its tests.
fn before_tests(path: &Path) -> String {
    let text = read_to_string(path).unwrap();
    text.split("#[cfg(test)]\nmod ").next().unwrap().to_owned()
}

/// Returns the same text without comments.
fn code(path: &Path) -> String {
    before_tests(path)
        .lines()
        .map(|line| line.split("//").next().unwrap().to_owned() + "\n")
        .collect()
}

/// Returns the rest of every path that begins with `start::`; braces are expanded.
fn paths(code: &str, start: &str) -> Vec<String> {
    let start = format!("{start}::");
    let begins =
        |at: &usize| !code[..*at].ends_with(|c: char| c.is_alphanumeric() || c == '_' || c == ':');
    let places = code.match_indices(&start).map(|(at, _)| at).filter(begins);
    places
        .flat_map(|at| expanded(&code[at + start.len()..]))
        .collect()
}

fn expanded(tree: &str) -> Vec<String> {
    let end = tree.find(|c: char| !(c.is_alphanumeric() || c == '_' || c == ':'));
    let (head, rest) = tree.split_at(end.unwrap_or(tree.len()));
    if !rest.starts_with('{') {
        return vec![head.to_owned()];
    }
    let (mut depth, mut first, mut found) = (0, 1, Vec::new());
    for (at, c) in rest.char_indices() {
        depth += i32::from(c == '{') - i32::from(c == '}');
        if (c == ',' && depth == 1) || depth == 0 {
            let branch = expanded(rest[first..at].trim_start());
            found.extend(branch.iter().map(|path| format!("{head}{path}")));
            first = at + 1;
        }
        if depth == 0 {
            break;
        }
    }
    found
}

#[test]
fn rooms_import_only_from_the_rows_below() {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let row = |room: &str| ROWS.iter().position(|row| row.contains(&room));
    let alone = modules(&source, true)
        .into_iter()
        .map(|(name, path)| (name.clone(), name, path));
    let in_folders = modules(&source, false)
        .into_iter()
        .flat_map(|(room, folder)| {
            let files = modules(&folder, true).into_iter();
            files.map(move |(name, path)| (room.clone(), format!("{room}/{name}"), path))
        });
    let mut wrong = Vec::new();
    for (room, file, path) in alone.chain(in_folders).filter(|(room, ..)| room != "lib") {
        let own = row(&room).unwrap_or_else(|| panic!("{room} has no row"));
        for path in paths(&code(&path), "crate") {
            let other = path.split("::").next().unwrap();
            if other != room && row(other).is_none_or(|other| other <= own) {
                wrong.push(format!("{file} imports crate::{path}"));
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn no_room_but_that_of_the_lenses_names_one() {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let folders = modules(&source, false).into_iter();
    let in_folders = folders
        .filter(|(room, _)| room != "lens")
        .flat_map(|(_, folder)| modules(&folder, true));
    let alone = modules(&source, true).into_iter();
    let all = alone.filter(|(name, _)| name != "lib").chain(in_folders);
    let naming = all.filter(|(_, path)| code(path).contains("Brown"));
    let wrong: Vec<PathBuf> = naming.map(|(_, path)| path).collect();
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn no_files_of_a_room_import_each_other_in_a_circle() {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    for (room, folder) in modules(&source, false) {
        let files = modules(&folder, true);
        let of_room = code(&files["mod"]);
        let (offered, private): (Vec<&str>, Vec<&str>) =
            of_room.split_inclusive(';').partition(|statement| {
                statement.contains("pub use ") || statement.contains("pub(crate) use ")
            });
        let (offered, private) = (offered.concat(), private.concat());
        let homes: BTreeMap<String, &String> = files
            .keys()
            .flat_map(|file| {
                paths(&offered, file)
                    .into_iter()
                    .map(move |name| (name, file))
            })
            .collect();
        // The file of a name: the one that mod.rs re-exports it from, else mod.rs itself.
        let home = |path: &String| {
            let first = path.split("::").next().unwrap();
            let file = files.keys().find(|file| *file == first);
            file.or(homes.get(first).copied())
                .map_or("mod", String::as_str)
        };
        let mut uses: BTreeMap<&str, BTreeSet<&str>> = BTreeMap::new();
        for (file, path) in &files {
            let code = code(path);
            let from_room = [
                paths(&code, "super"),
                paths(&code, &format!("crate::{room}")),
            ]
            .concat();
            let own = uses.entry(file).or_default();
            match file.as_str() {
                "mod" => own.extend(
                    files
                        .keys()
                        .filter(|f| !paths(&private, f).is_empty())
                        .map(String::as_str),
                ),
                _ => own.extend(from_room.iter().map(home).filter(|other| other != file)),
            }
        }
        // A file that imports none of the remaining files cannot be part of a cycle.
        while let Some(free) = uses
            .iter()
            .find(|(_, other)| other.is_empty())
            .map(|(file, _)| *file)
        {
            uses.remove(free);
            uses.values_mut().for_each(|other| _ = other.remove(free));
        }
        assert!(uses.is_empty(), "circles in {room}: {uses:#?}");
    }
}
