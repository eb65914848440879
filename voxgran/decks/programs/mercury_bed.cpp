
// Rows of a comma-separated file, each as its first word and its numbers.
struct Row {
    std::string name;
    std::vector<double> values;
};

std::vector<Row> readTable(const std::string& name, bool named) {
    std::ifstream file(name);
    if (!file) logger(ERROR, "cannot read %", name);
    std::vector<Row> rows;
    std::string line, word;
    while (std::getline(file, line)) {
        if (line.empty() || line[0] == '#') continue;
        std::istringstream words(line);
        Row row;
        if (named) std::getline(words, row.name, ',');
        while (std::getline(words, word, ',')) row.values.push_back(std::stod(word));
        rows.push_back(row);
    }
    return rows;
}

// A wall that keeps a stress.
struct Platen {
    BaseWall* wall;
    Vec3D outward;
    double force;
};

// Pebbles and inertia tensor.
typedef std::pair<std::vector<Row>, std::vector<Row>> Template;

class Bed : public Mercury3Dclump {
public:
    void setupInitialConditions() override {
        addGrains();
        addWalls();
    }

    // Pebbles carry the inverse mass of their clump, on which alone gravity and drag act.
    void computeExternalForces(BaseParticle* p) override {
        if (p->isPebble() || p->isFixed()) return;
        Mercury3Dclump::computeExternalForces(p);
        if (DRAG_TIME == 0.0) return;
        p->addForce((-1.0 / (p->getInvMass() * DRAG_TIME)) * p->getVelocity());
        p->addTorque((-1.0 / DRAG_TIME) * (p->getInertia() * p->getAngularVelocity()));
    }

    void computeInternalForce(BaseParticle* p, BaseParticle* q) override {
        if (p->isFixed() && q->isFixed()) return;
        setDamping(p->getIndSpecies(), q->getIndSpecies(), 1.0 / (p->getInvMass() + q->getInvMass()));
        Mercury3Dclump::computeInternalForce(p, q);
    }

    void computeForcesDueToWalls(BaseParticle* p, BaseWall* w) override {
        if (p->isFixed()) return;
        setDamping(p->getIndSpecies(), w->getIndSpecies(), 1.0 / p->getInvMass());
        Mercury3Dclump::computeForcesDueToWalls(p, w);
    }

    void actionsAfterTimeStep() override {
        if (getNumberOfTimeSteps() % STEPS_PER_OUTPUT == 0) writeGrains("mercury_state.csv");
    }

    bool continueSolve() const override {
        if (!SETTLES || getTime() < SETTLING_TIME || getNumberOfTimeSteps() % STEPS_PER_OUTPUT != 0) return true;
        for (const Platen& platen : platens_)
            if (std::fabs(Vec3D::dot(platen.wall->getForce(), platen.outward) / platen.force - 1.0) > STRESS_MET)
                return true;
        double energy = 0.0;
        for (const ClumpParticle* clump : clumps_) energy += clump->getKineticEnergy() + clump->getRotationalEnergy();
        return energy >= REST_ENERGY;
    }

    std::vector<SPECIES*> species;
    std::string grains = "mercury_grains.csv";

private:
    const Template& templateOf(const std::string& name) {
        const std::string stem = "mercury_" + name;
        if (templates_.count(name) == 0)
            templates_[name] = {readTable(stem + "_pebbles.txt", false), readTable(stem + "_toi.txt", false)};
        return templates_[name];
    }

    void addGrains() {
        for (const Row& row : readTable(grains, true)) {
            const Template& shape = templateOf(row.name);
            const std::vector<double>& v = row.values;
            const double fifth = std::pow(v[0], 5);
            const std::vector<Row>& toi = shape.second;
            ClumpParticle clump;
            clump.setSpecies(species[MATERIALS.at(row.name)]);
            clump.setClump();
            double largest = 0.0;
            for (const Row& pebble : shape.first) {
                const std::vector<double>& s = pebble.values;
                clump.addPebble(Vec3D(v[0] * s[0], v[0] * s[1], v[0] * s[2]), v[0] * s[3]);
                largest = std::max(largest, v[0] * s[3]);
            }
            clump.setRadius(largest);
            clump.setClumpMass(v[1]);
            // xx, xy, xz, yy, yz, zz in the principal frame
            clump.setInitInertia(MatrixSymmetric3D(fifth * toi[0].values[0], 0.0, 0.0, fifth * toi[1].values[1], 0.0,
                                                   fifth * toi[2].values[2]));
            clump.setPosition(Vec3D(v[2], v[3], v[4]));
            clump.setPrincipalDirections(Matrix3D(v[5], v[6], v[7], v[8], v[9], v[10], v[11], v[12], v[13]));
            clump.rotateTensorOfInertia();
            clump.setVelocity(Vec3D(v[14], v[15], v[16]));
            clump.setAngularVelocity(Vec3D(v[17], v[18], v[19]));
            clump.setDamping(0.0);
            rows_.push_back(row);
            clumps_.push_back(particleHandler.copyAndAddObject(clump));
        }
        for (const std::pair<unsigned, unsigned>& ends : FIXED)
            for (unsigned n = ends.first; n <= ends.second; ++n) clumps_[n - 1]->fixParticle();
        for (BaseParticle* p : particleHandler)
            if (p->isPebble() && p->getClump()->isFixed()) p->fixParticle();
    }

    void writeGrains(const std::string& name) const {
        std::ofstream file(name);
        file.precision(17);
        for (std::size_t n = 0; n < clumps_.size(); ++n) {
            const ClumpParticle& clump = *clumps_[n];
            const Vec3D x = clump.getPosition(), u = clump.getVelocity(), w = clump.getAngularVelocity();
            const Vec3D a = clump.getPrincipalDirections_e1(), b = clump.getPrincipalDirections_e2(),
                c = clump.getPrincipalDirections_e3();
            file << rows_[n].name << ',' << rows_[n].values[0] << ',' << rows_[n].values[1];
            for (double value : {x.X, x.Y, x.Z, a.X, b.X, c.X, a.Y, b.Y, c.Y, a.Z, b.Z, c.Z,
                                 u.X, u.Y, u.Z, w.X, w.Y, w.Z}) file << ',' << value;
            file << "\n";
        }
    }

    void addTriangles(const std::string& name) {
        for (const Row& row : readTable(name, false)) {
            const std::vector<double>& v = row.values;
            TriangleWall wall;
            wall.setSpecies(species[static_cast<unsigned>(v[9])]);
            wall.setVertices(Vec3D(v[0], v[1], v[2]), Vec3D(v[3], v[4], v[5]), Vec3D(v[6], v[7], v[8]));
            wallHandler.copyAndAddObject(wall);
        }
    }

    BaseWall* addPlane(Vec3D outward, Vec3D point, unsigned material) {
        InfiniteWall wall;
        wall.setSpecies(species[material]);
        wall.set(outward, point);
        return wallHandler.copyAndAddObject(wall);
    }

    // A wall that moves as a damper, so that the grains press on it with a force.
    void addPlaten(Vec3D outward, Vec3D point, unsigned material, double force, double speed) {
        BaseWall* wall = addPlane(outward, point, material);
        // outward is along an axis: walls that move are the upper ones
        wall->setForceControl(force * outward, (speed / force) * outward);
        platens_.push_back({wall, outward, force});
    }

    // side: what the shift to the next period has beside its part along the normal
    void addPeriodic(Vec3D normal, double low, double high, Vec3D side) {
        PeriodicBoundary boundary;
        boundary.set(normal, low, high);
        boundary.setPlanewiseShift(side);
        boundaryHandler.copyAndAddObject(boundary);
    }

    std::map<std::string, Template> templates_;
    std::vector<Row> rows_;
    std::vector<ClumpParticle*> clumps_;
    std::vector<Platen> platens_;
