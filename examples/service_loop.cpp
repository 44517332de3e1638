// A control loop in C++ with the service: the next twist once per period, and a stop by itself.
//
//     ergoqp serve screwing &
//     ergoqp serve --header > ergoqp_client.h
//     g++ -std=c++17 -O2 -I. service_loop.cpp -o service_loop
//     ./service_loop "$XDG_RUNTIME_DIR/ergoqp/screwing.sock"
//
// Robot and person are models here; yours are a driver and a camera. End the service while this runs: the object
// comes to rest along the stop that came with the last answer.
#include "ergoqp_client.h"

#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <thread>

namespace {

// A robot that holds each twist, and measures the pose of the object that it carries.
class Robot {
public:
    void put_at(const double (&pose)[16]) { std::memcpy(pose_, pose, sizeof pose_); }

    // Moves on, with the twist (velocity, then turning, both in the axes of the world).
    void execute(const double (&twist)[6], double seconds) {
        const double *w = twist + 3, speed = std::sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2]);
        const double angle = speed * seconds, s = std::sin(angle), c = 1 - std::cos(angle);
        double turned[16];
        std::memcpy(turned, pose_, sizeof turned);
        for (int column = 0; column < 3 && speed > 0; ++column) {
            const double x = pose_[column], y = pose_[4 + column], z = pose_[8 + column];
            const double axis[3] = {w[0] / speed, w[1] / speed, w[2] / speed};
            const double once[3] = {axis[1] * z - axis[2] * y, axis[2] * x - axis[0] * z, axis[0] * y - axis[1] * x};
            const double twice[3] = {axis[1] * once[2] - axis[2] * once[1], axis[2] * once[0] - axis[0] * once[2],
                                     axis[0] * once[1] - axis[1] * once[0]};
            for (int row = 0; row < 3; ++row) turned[4 * row + column] += s * once[row] + c * twice[row];
        }
        for (int row = 0; row < 3; ++row) turned[4 * row + 3] += seconds * twist[row];
        std::memcpy(pose_, turned, sizeof pose_);
    }

    void measure(double (&pose)[16]) const { std::memcpy(pose, pose_, sizeof pose_); }

private:
    double pose_[16] = {};
};

bool moves(const double (&twist)[6]) {
    for (double each : twist) {
        if (each != 0.0) return true;
    }
    return false;
}

}  // namespace

int main(int count, char** words) {
    constexpr unsigned joints = 32;
    constexpr double dt = 0.01, degree = 3.14159265358979323846 / 180;
    static ergoqp_client client;
    static ergoqp_client_input in;
    static ergoqp_client_output out;
    if (count < 2 || !ergoqp_client_init(&client, words[1], nullptr, joints, dt)) {
        std::fprintf(stderr, "usage: service_loop SOCKET [SECONDS]; %s\n",
                     count < 2 ? "" : ergoqp_client_reason(&client));
        return 2;
    }
    const int periods = static_cast<int>((count > 2 ? std::atof(words[2]) : 5.0) / dt);
    ergoqp_client_defaults(&in);
    in.posture[ERGOQP_CLIENT_JOINT_RIGHT_SHOULDER_FLEXION] = 75 * degree;
    in.posture[ERGOQP_CLIENT_JOINT_RIGHT_ELBOW_FLEXION] = 50 * degree;
    in.posture[ERGOQP_CLIENT_JOINT_RIGHT_WRIST_FLEXION] = -20 * degree;

    Robot robot;
    bool measured = false;
    auto next = std::chrono::steady_clock::now();
    for (int period = 0; period < periods; ++period) {
        // The service does not know what the robot does at first, and when it was started anew. This robot stands
        // once it is sent zero; ask yours.
        if (ergoqp_client_waits(&client) && !moves(out.twist)) ergoqp_client_reset(&client);
        if (measured) {
            in.flags |= ERGOQP_CLIENT_FLAG_POSE;
            robot.measure(in.pose);
        }
        const bool fresh = ergoqp_client_step(&client, &in, &out) == 1;
        if (fresh && !measured) {
            robot.put_at(out.pose);  // in the person's hand
            measured = true;
        }
        if (period % 50 == 0) {
            std::printf("%5.2f s  %-9s %5.1f mm/s  cost %.2f  %s\n", period * dt, ergoqp_client_status_name(out.status),
                        1000 * std::sqrt(out.twist[0] * out.twist[0] + out.twist[1] * out.twist[1] +
                                         out.twist[2] * out.twist[2]),
                        out.cost, ergoqp_client_reason(&client));
            std::fflush(stdout);
        }
        robot.execute(out.twist, dt);
        for (unsigned joint = 0; joint < joints; ++joint) in.posture[joint] += dt * out.posture_rate[joint];
        next += std::chrono::microseconds(10000);
        std::this_thread::sleep_until(next);
    }

    // Come to rest before the loop is given free.
    for (int period = 0; period < 200 && moves(out.twist); ++period) {
        ergoqp_client_brake(&client, &out);
        robot.execute(out.twist, dt);
        next += std::chrono::microseconds(10000);
        std::this_thread::sleep_until(next);
    }
    std::printf("at rest; late %llu, lost %llu, refused %llu\n", static_cast<unsigned long long>(client.late),
                static_cast<unsigned long long>(client.lost), static_cast<unsigned long long>(client.refused));
    ergoqp_client_close(&client);
    return 0;
}
