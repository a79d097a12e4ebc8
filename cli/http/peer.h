// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace l4d::cli {

// Whether the system says whose connections are.
bool tells_users();
// Whether the user of this process opened the connection from `peer_port` to `own_port`, both of
// 127.0.0.1. false where the system does not say.
bool is_own_user(int peer_port, int own_port);

}  // namespace l4d::cli
