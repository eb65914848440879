
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

// Pebbles and inertia tensor.
typedef std::pair<std::vector<Row>, std::vector<Row>> Template;

class Bed : public Mercury3Dclump {
public:
    void setupInitialConditions() override {
        addGrains();
        addWalls();
    }

    // Pebbles carry the inverse mass of their clump, on which alone gravity acts.
    void computeExternalForces(BaseParticle* p) override {
        if (!p->isPebble()) Mercury3Dclump::computeExternalForces(p);
    }

    void computeInternalForce(BaseParticle* p, BaseParticle* q) override {
        setDamping(1.0 / (p->getInvMass() + q->getInvMass()));
        Mercury3Dclump::computeInternalForce(p, q);
    }

    void computeForcesDueToWalls(BaseParticle* p, BaseWall* w) override {
        setDamping(1.0 / p->getInvMass());
        Mercury3Dclump::computeForcesDueToWalls(p, w);
    }

    void actionsAfterTimeStep() override {
        if (getNumberOfTimeSteps() % STEPS_PER_OUTPUT == 0) writeGrains("mercury_state.csv");
    }

    bool continueSolve() const override {
        if (!SETTLES || getTime() < SETTLING_TIME || getNumberOfTimeSteps() % STEPS_PER_OUTPUT != 0) return true;
        double energy = 0.0;
        for (const ClumpParticle* clump : clumps_) energy += clump->getKineticEnergy() + clump->getRotationalEnergy();
        return energy >= REST_ENERGY;
    }

    SPECIES* species = nullptr;
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
            clump.setSpecies(species);
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
            wall.setSpecies(species);
            wall.setVertices(Vec3D(v[0], v[1], v[2]), Vec3D(v[3], v[4], v[5]), Vec3D(v[6], v[7], v[8]));
            wallHandler.copyAndAddObject(wall);
        }
    }

    void addPlane(Vec3D outward, Vec3D point) {
        InfiniteWall wall;
        wall.setSpecies(species);
        wall.set(outward, point);
        wallHandler.copyAndAddObject(wall);
    }

    void addPeriodic(Vec3D normal, double low, double high) {
        PeriodicBoundary boundary;
        boundary.set(normal, low, high);
        boundaryHandler.copyAndAddObject(boundary);
    }

    std::map<std::string, Template> templates_;
    std::vector<Row> rows_;
    std::vector<ClumpParticle*> clumps_;
