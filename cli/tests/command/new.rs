use super::Folder;

#[test]
fn the_new_model_passes_everything() {
    let here = Folder::new();
    here.bond(&["new", "my-wall"]).is(0, &[], &["my-wall/my-wall.bond"]);
    assert_eq!(Folder::list(&Folder(here.0.join("my-wall"))), ["README.md", "my-wall.bond"]);
}

#[test]
fn the_new_model_runs() {
    let here = Folder::new();
    here.bond(&["new", "wall"]).is(0, &[], &[]);
    here.bond(&["check", "wall/wall.bond"]).is(0, &[], &["ok"]);
    here.bond(&["fmt", "--check", "wall/wall.bond"]).is(0, &[], &[]);
    here.bond(&["test", "wall"]).is(0, &["3 passed, 0 failed"], &[]);
    here.bond(&["run", "wall/wall.bond"]).is(0, &["passive     yes"], &[]);
    assert!(here.read("wall/README.md").contains("bond run wall.bond"));
}

#[test]
fn nothing_is_overwritten() {
    let here = Folder::new().with("wall/mine.txt", "mine").with("file", "mine");
    here.bond(&["new", "wall"]).is(2, &[], &["exists already"]);
    here.bond(&["new", "file"]).is(2, &[], &["exists already"]);
    assert_eq!(here.read("wall/mine.txt"), "mine");
    assert_eq!(here.list(), ["file", "wall"]);
}

#[test]
fn names_are_looked_at() {
    let here = Folder::new();
    let long = "x".repeat(300);
    for name in ["", ".", "..", "a/b", "../up", "-x", "1x", "a b", "a\nb", "a\u{1b}[31m", "C:x", &long] {
        here.bond(&["new", "--", name]).is(2, &[], &[]);
    }
    assert!(here.list().is_empty());
}
