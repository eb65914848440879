if (overlapDepth > 0) {{
    // one over the sum of reciprocals: a product of two masses may be too small for a float
    const float mass = 1.f / (1.f / AOwnerMass + 1.f / BOwnerMass);
{law}    float3 turnA = cross(ARotVel, locCPA);
    float3 turnB = cross(BRotVel, locCPB);
    applyOriQToVector3(turnA, AOriQ);
    applyOriQToVector3(turnB, BOriQ);
    const float3 relative = (ALinVel + turnA) - (BLinVel + turnB);
    const float apart = dot(relative, B2A);
    float3 slid = make_float3(slid_x, slid_y, slid_z);
    slid += ts * (relative - apart * B2A);
    const float lifted = dot(slid, B2A);
    slid -= lifted * B2A;
    force += (normal_stiffness * overlapDepth - damping * apart) * B2A;
    float3 drag = -drag_stiffness * slid;
    const float most = friction * length(force);
    const float drawn = length(drag);
    if (drawn > most) {{
        drag = (most / drawn) * drag;
        slid = (most / drawn) * slid;
    }}
    force += drag;
    slid_x = slid.x;
    slid_y = slid.y;
    slid_z = slid.z;
}} else {{
    slid_x = 0;
    slid_y = 0;
    slid_z = 0;
}}
