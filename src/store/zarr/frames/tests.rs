//! Tests of writing, reading, finishing and locking frames.

use super::*;

fn axis(name: &str, n: usize) -> FrameAxis {
    FrameAxis { name: name.into(), units: "1".into(), coords: (0..n).map(|i| i as f64).collect() }
}

#[test]
fn written_frames_are_read_back() {
    for (gathered, number) in [(false, FrameNumber::U16), (true, FrameNumber::U32)] {
        let dir = tempfile::tempdir().expect("a folder");
        let path = dir.path().join("f.zarr");
        let layout = FrameLayout {
            axes: vec![axis("capture", 3), axis("mask", 2), axis("y", 4), axis("x", 5)],
            run_axes: 2,
            gathered,
            number,
        };
        let map = FrameMap {
            name: "shot_of".into(),
            units: "1".into(),
            values: (0..layout.frame_len()).map(|i| i as f64).collect(),
        };
        let short = FrameMap { values: vec![0.0; 3], ..map.clone() };
        // A failed creation leaves no files.
        let maps = [map.clone(), short];
        assert!(FrameStore::create(&path, &layout, &maps, &Map::new(), false).is_err());
        assert!(!path.exists() && !staging::part_of(&path).exists());
        let store = FrameStore::create(&path, &layout, &maps[..1], &Map::new(), false).expect("a store");
        assert_eq!(store.read_map("shot_of").expect("reads"), Some(map.values.clone()));
        let chunks = layout.frames() / layout.frames_per_chunk();
        let len = layout.frames_per_chunk() * layout.frame_len();
        let chunk = |i: usize| -> Vec<u32> { (0..len).map(|k| (i * 1000 + k) as u32).collect() };
        for i in 0..chunks {
            store.write_chunk(i, &chunk(i)).expect("writes");
        }
        let angles: Vec<f64> = (0..6).map(f64::from).collect();
        store.write_column("angle", "degree", &angles).expect("writes");
        assert!(matches!(FrameStore::open(&path), Err(OpenError::Unfinished { .. })));
        assert!(matches!(FrameStore::open_for_write(&path), Err(OpenError::Locked { .. })));
        store.finish().expect("finishes");
        drop(store);
        let read = FrameStore::open(&path).expect("a store");
        assert_eq!(read.layout(), &layout);
        for i in 0..chunks {
            assert_eq!(read.read_chunk(i).expect("reads"), chunk(i));
        }
        assert_eq!(read.read_column("angle").expect("reads"), Some(angles));
        assert_eq!(read.read_column("none").expect("reads"), None);
        assert_eq!(read.read_map("shot_of").expect("reads"), Some(map.values));
        assert!(crate::zarr::verify(&path).expect("finished").faults.is_empty());
        assert!(matches!(
            FrameStore::create(&path, &layout, &[], &Map::new(), false),
            Err(CreateError::Exists { .. })
        ));
    }
}
