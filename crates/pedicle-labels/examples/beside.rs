use pedicle_labels::*; use pedicle_mesh::*;
fn main(){ let a:Vec<String>=std::env::args().collect(); let t=std::time::Instant::now();
 let s=import_label_map(&a[1],&ImportOptions::default(),&mut |_|{}).unwrap(); println!("{} s",t.elapsed().as_secs_f64());
 for l in &s.levels{ let r=read_mesh(format!("{}/{}.ply",a[2],l.level)).unwrap().mesh;
  let ps=connected_components(&r).faces(); let r=r.submesh_of_faces(ps.iter().max_by_key(|f|f.len()).unwrap()).unwrap().mesh;
  for (x,y) in [(&l.mesh,&r),(&r,&l.mesh)] { let i=SurfaceIndex::new(y).unwrap(); let mut d:Vec<f64>=x.vertices().iter().map(|p|i.closest_point(p).distance_mm).collect(); d.sort_by(f64::total_cmp);
   print!(" mean {:.3} p95 {:.3} max {:.3};", d.iter().sum::<f64>()/d.len() as f64, d[d.len()*95/100], d[d.len()-1]); }
  println!("{} vol {:+.4} change {:+.5} drop {} fill {} faces {} closed {} genus {:?} bad {:?} border {}",l.level,volume(&l.mesh)/volume(&r)-1.0,l.volume_change,l.n_dropped,l.n_filled,l.mesh.n_faces(),is_closed_manifold(&l.mesh),genus(&l.mesh), smallest_angle_rad(&l.mesh), l.border_area_mm2);
 }}
