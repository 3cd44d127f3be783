"""Bytes of radios, as published by their manufacturers."""

NODE_FRAME_2 = bytes.fromhex("""
    55 04 ac 00 02 01 ba 66 1d 00 06 09 ff de 0a 00 df ff ff e8 03 00 fa ff ff 1a 00 00 00 00 00 c0
    12 00 00 00 00 00 00 00 27 ac e2 3c 56 ed 1c 3c d2 70 3b bd 32 57 66 3e 3b cb 1b 41 93 70 61 bd
    25 b2 6b 41 a1 22 6c 41 da da 6b 41 6d 23 e9 23 70 dd db f7 30 3f 5f d6 31 3f ba 81 1e 3e 47 69
    e2 bd 91 9b 40 40 c5 23 00 00 40 40 5c d5 1c 00 00 00 1d 00 6d 13 04 01 00 6b 0c 00 b1 9f a6 66
    1d 00 16 45 01 01 ac 15 00 b4 a1 a6 66 1d 00 d3 01 01 02 48 1a 00 ca 9f a6 66 1d 00 38 ba 01 03
    2b 12 00 c6 a0 a6 66 1d 00 64 40 25""")
NODE_FRAME_3 = bytes.fromhex("""
    55 05 32 00 02 01 f8 11 07 00 6f d0 6e 00 00 00 01 02 5a 13 04 01 00 22 0b 00 b5 9f 01 01 a3 17
    00 b6 a0 01 02 88 1c 00 aa 9f 01 03 e6 14 00 b8 a0 9a""")
AOA_NODE_FRAME_0 = bytes.fromhex("""
    55 07 42 00 02 00 be 73 02 00 00 00 00 00 00 00 f1 06 ef 12 04 01 00 ff 02 00 22 0b a3 9f 9e 00
    01 01 02 03 00 ad 00 a4 9f 00 00 01 02 ec 03 00 cb 03 a5 a0 00 00 01 03 88 05 00 99 ec a3 a0 00
    00 33""")
LINKTRACK = {
    NODE_FRAME_2: ({0: 3.179, 1: 5.548, 2: 6.728, 3: 4.651}, 1926.822),
    NODE_FRAME_3: ({0: 2.850, 1: 6.051, 2: 7.304, 3: 5.350}, 463.352),
    AOA_NODE_FRAME_0: ({0: 0.767, 1: 0.770, 2: 1.004, 3: 1.416}, 160.702),
}
"""Frames of nooploop-dev/nlink_parser, test/test_nlink_parser.cpp, with the ranges by node and the
time, s. In frame 2 the time of a node is 20 ms before the frame's system_time of 1926842 ms."""

LES = (
    b"1151[5.00,8.00,2.25]=6.48 0CA8[0.00,8.00,2.25]=6.51 111C[5.00,0.00,2.25]=3.18"
    b" 1150[0.00,0.00,2.25]=3.16 le_us=2576 est[2.57,1.98,1.68,100]\r\n"
)
LEC = (
    b"DIST,4,AN0,1151,5.00,8.00,2.25,6.44,AN1,0CA8,0.00,8.00,2.25,6.50,"
    b"AN2,111C,5.00,0.00,2.25,3.24,AN3,1150,0.00,0.00,2.25,3.19,POS,2.55,2.01,1.71,98\r\n"
)
DWM1001 = {
    LES: {0x1151: 6.48, 0x0CA8: 6.51, 0x111C: 3.18, 0x1150: 3.16},
    LEC: {0x1151: 6.44, 0x0CA8: 6.50, 0x111C: 3.24, 0x1150: 3.19},
}
"""The examples of the DWM1001 Firmware API Guide, shell commands les and lec."""
LEC_OVERRUN = (
    b"DIST,4,AN0,0090,0.00,0.00,0.00,3.25,AN1,D91E,0.00,0.00,0.00,3.33,"
    b"AN2,0487,0.00,0.00,0.00,0.18,AN3,15BA,0.00,0,AN3,15BA,0.00,0.00,0.00,0.00\r\n"
)
"""A line that a DWM1001 printed at a high update rate, from Rutgers' localization scripts. A part
of the field AN3 is missing."""
