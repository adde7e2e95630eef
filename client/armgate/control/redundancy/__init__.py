"""Redundancy toolbox: properties of a Jacobian, and uses of redundant joints.

It follows the lecture "Kinematic Redundancy" (R. Platt, Northeastern University; slide numbers in this
package refer to it), for any robot with a URDF and any task rows. Functions that need only a Jacobian take a
matrix J (m, n), the others a task.

    spaces          range and null spaces, rank, singular directions                slides 3-9, 28-33
    inverses        pseudoinverse, weighted, damped with fixed or variable damping  slides 10-13
    measures        manipulability, condition number, isotropy                      slides 19-22
    ellipsoids      velocity and force ellipsoids                                   slides 14-26
    statics         τ = JᵀF with its null and range spaces                          slides 34-36
    resolution      a wanted q̇₀ in the null space of a task                         slides 38-40
    tasks           rows of the Jacobians of frames, and their exact derivative
    selfmotion      curves of joint positions with the same task pose                slide 29
    objectives      potentials that a robot lowers in its null space                slides 41-42
    distance        distances of points from primitive shapes
    reach           controllers that move a task to a target
"""
