"""An example of each command."""

#: an example of each command, shown at the end of its help
EXAMPLES: dict[str, str] = {
    "init": "voxgran init scene.toml",
    "plan": "voxgran plan scene.toml",
    "run": "voxgran run scene.toml -o out\n  voxgran run scene.toml -o out --resume",
    "verify": "voxgran verify out/packing.vtp",
    "settle": "voxgran settle loose.vtp -o bed.vtp --friction 0.3\n"
    "  voxgran settle spheres.txt --periodic xy --gravity -z -o bed.vtp --shaking-duration 20",
    "compress": "voxgran compress loose.vtp -o specimen.vtp --friction 0.3\n"
    "  voxgran compress loose.vtp -o oedometer.vtp --axes z --solid-fraction 0.6",
    "tile": "voxgran tile bed.vtp --repeats 4,4,1 -o large.vtp",
    "equilibrium": "voxgran equilibrium bed.vtp --friction 0.5",
    "measure": "voxgran measure out/packing.vtp --which density --which coordination -o statistics.nc",
    "report": "voxgran report out/packing.vtp -o report.html",
    "picture": "voxgran picture out/packing.vtp -o bed.png --color-by height --cut",
    "compare": "voxgran compare digital=out/digital points=out/points -o comparison.html",
    "image": "voxgran image info scan.tif",
    "segment": "voxgran segment grey.tif --voxel-size 0.1,0.1,0.2 -o labels.vti --picture slices.png",
    "labels": "voxgran labels scan.tif --voxel-size 0.02,0.02,0.05 --unit mm -o scan.vtp\n"
    "  voxgran labels grey.tif --segment --voxel-size 0.02 -o scan.vtp",
    "twin": "voxgran twin scan.vtp --count 2000 -o out/",
    "learn": "voxgran learn scan.vtp -o shapes.nc --picture pairs.png\n"
    "  voxgran shape learned --model shapes.nc --count 100 -o grains",
    "shape": "voxgran shape solid_union --seed 7 --solids 3,5 -o grain.stl\n"
    "  voxgran shape convex_polyhedron --count 300 --points 8,20 -o grains --gallery grains.png",
    "repair": "voxgran repair scan.ply -o rock.ply\n  voxgran repair scan.ply --bodies largest --max-hole 0.1",
    "simplify": "voxgran simplify scan.stl --faces 500 -o small.stl",
    "cloud": "voxgran cloud scan.ply --outliers 2 -o rock.stl",
    "clump": "voxgran clump rock.stl --spheres 50 -o rock.csv --picture rock.png\n"
    "  voxgran clump rock.stl --target iou --value 0.95 --mode balanced -o rock.mol",
    "export": "voxgran export bed.vtp --engine lammps -o run\n"
    "  voxgran export bed.vtp --engine yade --clump 50 --density 2650 --friction 0.4 -o run",
    "relax": "voxgran relax bed.vtp -o rested.vtp --history rested.nc",
    "engines": "voxgran engines",
    "methods": "voxgran methods\n  voxgran methods digital",
    "study": "voxgran study study.toml --dry-run\n  voxgran study study.toml -o out --workers 4\n"
    "  voxgran study study.toml -o out --dask tcp://127.0.0.1:8786",
    "bench": "voxgran bench voxelize -o figures",
    "doctor": "voxgran doctor\n  voxgran doctor --warm",
    "data": "voxgran data itokawa_lp.obj -o rock.obj",
    "demo": "voxgran demo -o out/demo",
    "app": "voxgran app\n  voxgran app scene.toml -o runs",
}
