"""Redundancy toolbox: what a Jacobian can do, what it cannot, and what to do with the joints that are over.

After the lecture "Kinematic Redundancy" (R. Platt, Northeastern University; slide numbers in this package are
its), for any robot of a URDF and any task rows. What needs only a Jacobian takes a matrix J (m, n), the rest
a task.

    spaces          range and null spaces, rank, singular directions                slides 3-9, 28-33
    inverses        pseudoinverse, weighted, damped with fixed or variable damping  slides 10-13
    measures        manipulability, condition number, isotropy                      slides 19-22
    ellipsoids      velocity and force ellipsoids                                   slides 14-26
    statics         τ = JᵀF with its null and range spaces                          slides 34-36
    resolution      a wanted q̇₀ in the null space of a task                         slides 38-40
    tasks           rows of the Jacobians of frames, and their exact derivative
    selfmotion      curves of joint positions that hold a task                      slide 29
    objective       potentials that a robot may lower in its null space             slides 41-42
    singularities, centring, avoidance                                              the three of them
    distance        points against primitive shapes
    reach           controllers that bring a task to a target
"""
